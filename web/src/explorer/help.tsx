// All keys on one page, and what is where.
import { useEffect, useRef } from "preact/hooks";
import { helpOpen } from "./ui";
import { KEYS as WATCH_KEYS } from "./watch/keys";

const KEYS: readonly { readonly keys: string; readonly what: string }[] = [
  { keys: "j, k", what: "next, previous case of the list" },
  { keys: "↑ ↓ Page Home End", what: "move in the list, when it has the focus" },
  { keys: "Enter", what: "watch the case under the cursor" },
  { keys: "Shift Enter", what: "put the case under the cursor beside the watched one (Shift and click does it too)" },
  { keys: "Esc", what: "close what is open: this help, the lasso, the case" },
  { keys: "/", what: "find a case by its name" },
  { keys: "f", what: "to the filters" },
  { keys: "c", what: "to the colours of the map" },
  { keys: "l", what: "lasso: draw a line around cases (Shift and drag does it too)" },
  { keys: "arrows, + − 0", what: "move the map, nearer, farther, everything, when it has the focus" },
  { keys: "?", what: "this help" },
];

export function Help() {
  const dialog = useRef<HTMLDialogElement>(null);
  useEffect(() => {
    if (helpOpen.value && !dialog.current!.open) dialog.current!.showModal();
    if (!helpOpen.value && dialog.current!.open) dialog.current!.close();
  }, [helpOpen.value]);
  return (
    <dialog class="help" ref={dialog} aria-labelledby="help-title" onClose={() => (helpOpen.value = false)}
      onClick={(event) => { if (event.target === event.currentTarget) helpOpen.value = false; }}>
      <div class="help-body">
        <header class="pane-head">
          <h2 id="help-title">Help</h2>
          <button type="button" aria-label="Close the help" onClick={() => (helpOpen.value = false)}>✕</button>
        </header>
        <p>Each point of the map, and each row of the list, is one crash of the automated vehicle (AV). Cases near each other happened in a similar way.
          Filters, the lasso and the legend choose among them; map, list and counts follow. The address of the page holds all of it: send it, and others see the same.</p>
        <p>A case that is watched takes the keys of the second table, unless the map, the list or a filter has the focus.</p>
        <div class="key-tables">
          <Keys title="Everywhere" keys={KEYS} />
          <Keys title="While a case is watched" keys={WATCH_KEYS} />
        </div>
      </div>
    </dialog>
  );
}

function Keys({ title, keys }: { title: string; keys: readonly { readonly keys: string; readonly what: string }[] }) {
  return (
    <table>
      <caption>{title}</caption>
      <tbody>{keys.map(({ keys: key, what }) => <tr key={key}><th scope="row"><kbd>{key}</kbd></th><td>{what}</td></tr>)}</tbody>
    </table>
  );
}
