export const TEMPLATES: string;
export const PAGES: Readonly<Record<string, string>>;
export function pageScripts(): Promise<Record<string, string>>;
