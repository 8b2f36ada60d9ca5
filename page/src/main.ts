/** The report's program: a player for each scene of the page. */

import "uplot/dist/uPlot.min.css";
import "./style.css";
import { Charts } from "./charts";
import { type Chart, type PageData, readJson, type Scene } from "./data";
import { Player } from "./player";

declare global {
  interface Window {
    /** For tests and scripts of readers: the players, and the plots of studies, in the order of the page. */
    simspec: { players: Player[]; charts: Charts[] };
  }
}

async function main(): Promise<void> {
  const page: PageData = { ...readJson<{ scenes: Scene[]; charts: Chart[][] }>("scenes"), packed: readJson("packed") };
  const players: Player[] = [];
  const charts: Charts[] = [];
  window.simspec = { players, charts };
  for (const [index, described] of page.charts.entries()) {
    const box = document.getElementById(`charts-${index}`);
    if (box === null) throw new Error(`the page has no plots ${index}`);
    charts.push(new Charts(described, box));
  }
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
