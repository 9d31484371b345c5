export const PAGES: string;
export function pageScript(): Promise<string>;
