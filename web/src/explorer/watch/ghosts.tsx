// Which drivers are shown in the AV's place, and what each would have done.
import type { Ghosts, WatchedCase } from "../api";
import { ghosts } from "../state";
import type { Loaded } from "./loaded";
import { toggleGhost } from "./player";
import { contactAt } from "./run";
import { WAY_OUT, ghostColours } from "./view";

export function GhostToggles({ item, drivers, loaded }: { item: WatchedCase; drivers: readonly string[]; loaded: Loaded<Ghosts> }) {
  const contact = contactAt(item);
  const known = loaded.state === "there" ? loaded.value.drivers : {};
  if (item.wayOut === null && drivers.length === 0) return null;
  const when = (seconds: number | null) =>
    seconds === null ? "does not react"
      : seconds <= contact - 0.05 ? `reacts ${(contact - seconds).toFixed(1)} s before contact`
        : seconds < contact + 0.05 ? "reacts at the moment of the contact" : "reacts after it";
  return (
    <fieldset class="ghosts">
      <legend>In the AV's place</legend>
      <Toggle name={WAY_OUT} label="last way out" drivers={drivers} isThere={item.wayOut !== null}
        said={item.wayOut === null ? "none is known" : `begins ${Math.max(0, contact - (item.first + item.wayOut.from) * item.dt).toFixed(1)} s before contact`} />
      {drivers.map((name) => {
        const ghost = known[name];
        const said = ghost ? `${ghost.prevents ? "would have prevented it" : "would not have prevented it"}; ${when(ghost.reacts_s)}`
          : loaded.state === "loading" ? "is being driven …" : "not known";
        return <Toggle key={name} name={name} label={name} drivers={drivers} isThere={ghost !== undefined} said={said} prevents={ghost?.prevents} />;
      })}
      {loaded.state === "failed" && <p class="note">The reference drivers cannot be shown. {loaded.message}</p>}
    </fieldset>
  );
}

interface ToggleProps {
  name: string;
  label: string;
  drivers: readonly string[];
  isThere: boolean;
  said: string;
  prevents?: boolean | undefined;
}

function Toggle({ name, label, drivers, isThere, said, prevents }: ToggleProps) {
  const { colour } = ghostColours(name, drivers);
  return (
    <label class={isThere ? "" : "absent"}>
      <input type="checkbox" checked={ghosts.value.has(name) && isThere} disabled={!isThere} onChange={() => toggleGhost(name)} />
      <span class={`swatch ${colour}`} />
      <b>{label}</b> <span class="said">{prevents === undefined ? "" : prevents ? "✓ " : "✗ "}{said}</span>
    </label>
  );
}
