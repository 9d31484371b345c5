// The pane at the right: the list of cases, or the case that is watched with the list one key away.
import { about, rowOf } from "./data";
import { count, shortName } from "./format";
import { List } from "./list";
import { playing, watched } from "./state";
import { listOver, tab } from "./ui";
import { rows, step } from "./views";
import { Watch } from "./watch/watch";

export function SidePane() {
  const key = watched.value;
  if (key === null || listOver.value) {
    return (
      <>
        {key !== null && (
          <p class="back">
            <button type="button" onClick={() => (listOver.value = false)}>Back to case {shortName(key.slice(key.indexOf("/") + 1))}</button>
          </p>
        )}
        <List />
      </>
    );
  }
  const place = rows.value.indexOf(rowOf(key));
  return (
    <>
      <header class="pane-head case-head">
        <button type="button" title="The list (Esc closes the case)" onClick={() => { listOver.value = true; tab.value = "list"; }}>☰ List</button>
        <button type="button" title="Previous case of the list (k)" disabled={place === 0 || rows.value.length === 0} onClick={() => step(-1)}>↑ Previous</button>
        <button type="button" title="Next case of the list (j)" disabled={place === rows.value.length - 1} onClick={() => step(1)}>↓ Next</button>
        <span class="quiet place">{place >= 0 ? `${count(place + 1)} of ${count(rows.value.length)}` : "not among the filtered"}</span>
        <button type="button" class="close" aria-label="Close the case" title="Close (Esc)" onClick={closeCase}>✕</button>
      </header>
      <div class="pane-body case-body" id="case" tabIndex={-1}>
        {about.value && <Watch about={about.value} caseKey={key} />}
      </div>
    </>
  );
}

export function closeCase(): void {
  playing.value = false;
  watched.value = null;
  listOver.value = false;
}
