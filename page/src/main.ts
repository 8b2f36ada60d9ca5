/** The report's program: a player for each scene of the page. */

import "uplot/dist/uPlot.min.css";
import "./style.css";
import { type PageData, readJson, type Scene } from "./data";
import { Player } from "./player";

declare global {
  interface Window {
    /** For tests and scripts of readers: the players, in the order of the page. */
    simspec: { players: Player[] };
  }
}

async function main(): Promise<void> {
  const page: PageData = { ...readJson<{ scenes: Scene[] }>("scenes"), packed: readJson("packed") };
  const players: Player[] = [];
  window.simspec = { players };
  for (const [index, scene] of page.scenes.entries()) {
    const section = document.getElementById(`scene-${index}`);
    if (section === null) throw new Error(`the page has no scene ${index}`);
    players.push(await Player.open(page, scene, section));
  }
}

main().then(
  () => (document.documentElement.dataset.state = "ready"),
  (error: unknown) => {
    document.documentElement.dataset.state = "failed";
    const note = document.createElement("p");
    note.className = "failed";
    note.textContent = `The playback and the plots could not be shown (${error}). The tables are complete.`;
    document.querySelector("main")?.prepend(note);
    console.error(error);
  },
);
