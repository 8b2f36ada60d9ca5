/** Which bodies may touch: a list, and a choice of a body whose partners the picture shows. */

import type { Scene } from "./data";
import type { Stage } from "./stage";

const NAMED = 12;
/** Bodies that a choice offers. */
const MOST_CHOICES = 400;

/** Those that may touch the bodies of each class. */
function partners(scene: Scene): number[][][] {
  const { classes, pairs } = scene.model.contacts;
  const found: number[][][] = classes.map(() => []);
  for (const [first, second] of pairs) {
    found[first].push(classes[second]);
    if (first !== second) found[second].push(classes[first]);
  }
  return found;
}

/** List what may touch what, in a box that is hidden otherwise. */
export function listContacts(scene: Scene, stage: Stage | null, box: HTMLDetailsElement): void {
  const { classes, pairs, bodies } = scene.model.contacts;
  const list = box.querySelector("ul");
  if (list === null || bodies < 2) return;
  box.hidden = false;
  const said = (text: string): HTMLLIElement => {
    const item = document.createElement("li");
    item.textContent = text;
    list.append(item);
    return item;
  };
  if (!pairs.length) said(classes.length || bodies <= 600 ? "None." : `Not listed for ${bodies} bodies.`);
  const names = (members: number[], most: number) => {
    const named = members.slice(0, most).map((body) => scene.bodies[body]);
    return named.join(", ") + (members.length > most ? ` and ${members.length - most} more` : "");
  };
  const found = partners(scene);
  classes.forEach((members, index) => {
    const others = found[index].flat();
    const apart = others.filter((body) => !members.includes(body));
    const parts = [...(apart.length < others.length ? ["each other"] : []), ...(apart.length ? [names(apart, NAMED)] : [])];
    const item = said(`${names(members, 4)} – ${parts.join(", ")}`);
    item.tabIndex = 0;
    for (const event of ["pointerenter", "focus"]) item.addEventListener(event, () => stage?.highlight(members, apart));
    for (const event of ["pointerleave", "blur"]) item.addEventListener(event, () => stage?.highlight([]));
  });
}

/** A choice of a body that shows what may touch it; null where there is nothing to choose. */
export function chooseContacts(scene: Scene, stage: Stage): HTMLSelectElement | null {
  const { classes } = scene.model.contacts;
  const offered = classes.flatMap((members, index) => members.map((body) => ({ body, index }))).sort((a, b) => a.body - b.body);
  if (!offered.length || offered.length > MOST_CHOICES) return null;
  const found = partners(scene);
  const choice = document.createElement("select");
  choice.setAttribute("aria-label", "contact partners");
  choice.add(new Option("contact partners of …", ""));
  for (const { body } of offered) choice.add(new Option(scene.bodies[body], String(body)));
  choice.addEventListener("change", () => {
    const chosen = offered[choice.selectedIndex - 1];
    if (chosen === undefined) stage.highlight([]);
    else stage.highlight([chosen.body], found[chosen.index].flat().filter((body) => body !== chosen.body));
  });
  return choice;
}
