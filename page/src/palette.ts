/** Colours that the colour-blind tell apart (Okabe and Ito 2008), in the order in which runs and lines take them: of the first
 * three and the first four the mixture, which overlaid bodies have where all agree, is nearly grey. */

const PALETTE = ["#0072b2", "#e69f00", "#cc79a7", "#009e73", "#d55e00", "#56b4e9", "#f0e442", "#777777"];
/** The colours that need white text. */
const DARK = new Set(["#0072b2", "#777777"]);

export function colour(index: number): string {
  return PALETTE[index % PALETTE.length];
}

/** Paint an element's background, and its text so that it can be read. */
export function fill(element: HTMLElement, index: number): void {
  element.style.background = colour(index);
  element.style.color = DARK.has(colour(index)) ? "#ffffff" : "#000000";
}
