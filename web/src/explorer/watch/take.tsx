// What can be taken away: files, and the command that drives the case again.
import { useSignal } from "@preact/signals";
import { type About, type WatchedCase, downloadUrl } from "../api";

export function Take({ about, item }: { about: About; item: WatchedCase }) {
  const said = useSignal("");
  const slash = item.key.indexOf("/");
  const source = about.sources.find(({ name }) => name === item.key.slice(0, slash));
  const command = source ? `${source.replay} ${item.key.slice(slash + 1)}` : "";
  const copy = async () => {
    try {
      await navigator.clipboard.writeText(command);
      said.value = "Copied.";
    } catch {
      said.value = "The browser does not let this page copy; mark the command and copy it.";
    }
  };
  return (
    <details class="take">
      <summary>Download, drive again</summary>
      {about.downloads.length > 0 && (
        <ul>{about.downloads.map(({ format, label }) => <li key={format}><a href={downloadUrl(item.key, format)} download>{label}</a></li>)}</ul>
      )}
      {command && <p><code>{command}</code> <button type="button" onClick={() => void copy()}>Copy</button> <span role="status">{said.value}</span></p>}
    </details>
  );
}
