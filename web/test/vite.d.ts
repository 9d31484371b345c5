interface ImportMeta {
  /** Vite's, in tests: the files that match, by path. */
  glob<T>(pattern: string, options: { query: string; import: string; eager: true }): Record<string, T>;
}
