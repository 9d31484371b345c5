// The facts of a case in the order of the questions that a reader asks. Pure.
import { show, showSmall } from "../../shared/format";
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
  /** What stands first, by the column's name, as a reader calls it; null: as the server does. */
  readonly first: Readonly<Record<string, string | null>>;
  readonly more: RegExp;
}

const GROUPS: readonly Group[] = [
  {
    title: "What happened",
    first: {
      mechanism: null, crash_type: null, side: null, striker: null, bv_kind: null, impact_speed_mps: "speed relative to each other at contact",
      av_speed_mps: "speed of the AV at contact", bv_speed_mps: "speed of the BV at contact", av_delta_v_mps: "change of the AV's velocity (delta-v)",
      av_injury_probability: null, crash_time_s: "contact, after the begin of the test",
    },
    more: /^(bv_slot|bv_length|bv_width|av_lane|relative_|impact_|duration|bv_delta_v|bv_injury|av_force|bv_force|physically)/,
  },
  {
    title: "How often",
    first: { often: null, weight: "crashes per test that it stands for", possible_shortfall_nats: "how unlikely the BV's actions were (shortfall)", n_impossible: "actions impossible in natural traffic", n_implausible: "actions hardly ever seen in natural traffic" },
    more: /^(log_prob|shortfall|excess|n_decisions)/,
  },
  {
    title: "What it did wrong, and who broke a rule of RSS",
    first: { fault: null, fault_rule: null, fault_s: "rule broken, before contact", conduct: null, conduct_s: "it began, before contact" },
    more: /^(av_rule|av_fault|bv_rule|bv_fault|blame|conduct)/,
  },
  {
    title: "What would have prevented it",
    first: {
      prevention: null, prevented_by: "reference drivers that would have", held_speed_prevents: "to hold the speed would have", way_out: null, avoidability: "the AV could have avoided it",
      manoeuvre_begin_s: "manoeuvre began, before contact", latest_any_s: "last way out, before contact", time_to_react_s: "time to react (from one to the other)",
    },
    more: /^(latest_|avoidability|least_ttc|braking_)/,
  },
  { title: "Why look at it", first: { role: "shown as", value: "value of the case, 0 to 1" }, more: /^(value_|cluster|group|pc\d)/ },
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
  const print = unit.replace("m/s2", "m/s²");
  const size = Math.abs(value);
  if (size === 0 || !Number.isFinite(value) || size >= 1e-4) return show(value, print, digitsOf(value));
  return `${showSmall(value)} ${print}`.trim();
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
  const row = (fact: Fact, label: string | null = null): FactRow => {
    used.add(fact.name);
    const column = columnOf.get(fact.name);
    return { name: fact.name, label: label ?? column?.label ?? labelOf(fact.name), value: inWords(fact, column?.values), meaning: fact.meaning };
  };
  const isKnown = (fact: Fact | undefined): fact is Fact => fact !== undefined && fact.value !== null && fact.value !== "";
  const groups = GROUPS.map(({ title, first, more }) => {
    const rows = Object.entries(first).flatMap(([name, label]) => {
      const fact = byName.get(name);
      return isKnown(fact) ? [row(fact, label)] : [];
    });
    return { title, rows, more: facts.filter((fact) => !used.has(fact.name) && more.test(fact.name)).map((fact) => row(fact)) };
  });
  const rest = facts.filter((fact) => !used.has(fact.name) && !["case_id", "source", "key"].includes(fact.name)).map((fact) => row(fact));
  return [...groups, { title: MEASURES, rows: [], more: rest }].filter(({ rows, more }) => rows.length + more.length > 0);
}

/** A number of the facts; null: not known. */
export function factNumber(facts: readonly Fact[], name: string): number | null {
  const value = facts.find((fact) => fact.name === name)?.value;
  return typeof value === "number" && Number.isFinite(value) ? value : null;
}
