// What is fetched: on its way, there, or failed with the reason in one line.
import { useEffect, useRef, useState } from "preact/hooks";

export type Loaded<T> =
  | { readonly state: "loading" }
  | { readonly state: "there"; readonly value: T }
  | { readonly state: "failed"; readonly message: string; again(): void };

/** Fetch anew whenever `name` changes; what an earlier name asked for is given up. */
export function useLoaded<T>(fetch: (signal: AbortSignal) => Promise<T>, name: string): Loaded<T> {
  const [round, setRound] = useState(0);
  const [found, setFound] = useState<{ name: string; loaded: Loaded<T> }>({ name, loaded: { state: "loading" } });
  const latest = useRef(fetch);
  latest.current = fetch;
  useEffect(() => {
    const ending = new AbortController();
    const put = (loaded: Loaded<T>) => { if (!ending.signal.aborted) setFound({ name, loaded }); };
    put({ state: "loading" });
    latest.current(ending.signal).then(
      (value) => put({ state: "there", value }),
      (cause: unknown) => put({ state: "failed", message: cause instanceof Error ? cause.message : String(cause), again: () => setRound((n) => n + 1) }),
    );
    return () => ending.abort();
  }, [name, round]);
  return found.name === name ? found.loaded : { state: "loading" };
}
