// The facts of a case in the order of the questions that a reader asks. Pure.
import { show } from "../../shared/format";
import type { ColumnInfo, Fact } from "../api";

export interface FactRow {
  readonly name: string;
  readonly label: string;
  readonly value: string;
  readonly meaning: string;
}

export interface FactGroup {
  readonly title: string;
  /** What a reader wants to know first. */
  readonly rows: readonly FactRow[];
  /** The rest of the group. */
  readonly more: readonly FactRow[];
}

/** What the server may say of a column beyond its type: its name for people, and its values in words. */
type Column = ColumnInfo & { readonly label?: string; readonly values?: Readonly<Record<string, string>> };

interface Group {
  readonly title: string;
  readonly first: readonly string[];
  readonly more: RegExp;
}

const GROUPS: readonly Group[] = [
  {
    title: "What happened",
    first: ["mechanism", "crash_type", "side", "striker", "bv_kind", "impact_speed_mps", "av_speed_mps", "bv_speed_mps", "av_delta_v_mps", "av_injury_probability", "crash_time_s"],
    more: /^(bv_slot|bv_length|bv_width|av_lane|relative_|impact_|duration|bv_delta_v|bv_injury|av_force|bv_force|physically)/,
  },
  { title: "How often", first: ["often", "weight", "possible_shortfall_nats", "n_implausible"], more: /^(log_prob|shortfall|n_impossible|n_decisions)/ },
  { title: "Whose fault", first: ["fault", "fault_rule", "fault_s", "conduct", "conduct_s"], more: /^(av_rule|av_fault|bv_rule|bv_fault|blame|conduct)/ },
  {
    title: "What would have prevented it",
    first: ["prevention", "prevented_by", "held_speed_prevents", "way_out", "avoidability", "manoeuvre_begin_s", "latest_any_s", "time_to_react_s"],
    more: /^(latest_|avoidability|least_ttc|braking_)/,
  },
  { title: "Why look at it", first: ["role", "value"], more: /^(value_|cluster|group|pc\d)/ },
];
const MEASURES = "Measures";

/** A value as a person reads it. */
export function inWords(fact: Fact, values?: Readonly<Record<string, string>>): string {
  const { value, unit } = fact;
  if (value === null || value === "") return "–";
  if (typeof value === "boolean") return value ? "yes" : "no";
  if (typeof value === "string") {
    const said = values?.[value] ?? value;
    return isNumberWord(value) ? (value.startsWith("-") || value.startsWith("minus") ? "−∞" : "∞") : said;
  }
  return show(value, unit, digitsOf(value)).replace(/^(.*?)e\+?(−?)(-?)(\d+)/, "$1 · 10^$2$4");
}

const isNumberWord = (text: string): boolean => /^(-|minus )?inf(inite|inity)?$/.test(text);

/** Three digits that tell something; whole numbers stay whole. */
function digitsOf(value: number): number {
  if (Number.isInteger(value) || !Number.isFinite(value)) return 0;
  const size = Math.abs(value);
  return size >= 100 ? 0 : Math.min(12, Math.max(1, 1 - Math.floor(Math.log10(size))));
}

/** "min_ttc_front_s" as words: the unit stands behind the value. */
const labelOf = (name: string): string => name.replace(/_(mps2|mps|s|m|rad|nats)$/, "").replaceAll("_", " ").replace(/\bav\b/g, "AV").replace(/\bbv\b/g, "BV");

export function factGroups(facts: readonly Fact[], columns: readonly Column[]): FactGroup[] {
  const byName = new Map(facts.map((fact) => [fact.name, fact]));
  const columnOf = new Map(columns.map((column) => [column.name, column]));
  const used = new Set<string>();
  const row = (fact: Fact): FactRow => {
    used.add(fact.name);
    const column = columnOf.get(fact.name);
    return { name: fact.name, label: column?.label ?? labelOf(fact.name), value: inWords(fact, column?.values), meaning: fact.meaning };
  };
  const isKnown = (fact: Fact | undefined): fact is Fact => fact !== undefined && fact.value !== null && fact.value !== "";
  const groups = GROUPS.map(({ title, first, more }) => {
    const rows = first.map((name) => byName.get(name)).filter(isKnown).map(row);
    return { title, rows, more: facts.filter((fact) => !used.has(fact.name) && more.test(fact.name)).map(row) };
  });
  const rest = facts.filter((fact) => !used.has(fact.name) && !["case_id", "source", "key"].includes(fact.name)).map(row);
  return [...groups, { title: MEASURES, rows: [], more: rest }].filter(({ rows, more }) => rows.length + more.length > 0);
}

/** A number of the facts; null: not known. */
export function factNumber(facts: readonly Fact[], name: string): number | null {
  const value = facts.find((fact) => fact.name === name)?.value;
  return typeof value === "number" && Number.isFinite(value) ? value : null;
}
