import { de } from "./de";
import { en, type Words } from "./en";

/** The languages of the page, by their tags. */
export const languages: Record<string, Words> = { en, de };

/** The tag of the language that the reader wants most. */
export function wanted(): string {
  const kept = localStorage.getItem("esm.language");
  if (kept && languages[kept]) return kept;
  for (const tag of navigator.languages ?? []) {
    const short = tag.slice(0, 2);
    if (languages[short]) return short;
  }
  return "en";
}
