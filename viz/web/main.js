// The page of results: what it holds, or what the program that serves it sends.
import { $ } from "./format.js";
import { Player } from "./player.js";
import { Results } from "./studio/results.js";
import { STILL } from "./theme.js";

const payload = JSON.parse($("payload").textContent), player = new Player(), results = new Results(player);
if (payload.runs.length) {
  results.load(payload);
  if (payload.autoplay && !STILL.matches) player.timeline.play();
  player.link.follow();
} else player.wait(payload);
if (payload.runs.length || !payload.live) player.busy.end(); else player.busy.say("waiting for the program");
if (payload.live) follow();
// A program that records draws picture after picture, each when it asks for it.
Object.assign(window, { spacerobotFilm: {
  begin: (level) => player.stage(level),
  level: (level) => { player.scene.quality.fixed = level; player.scene.quality.tick(0, false); },
  shown: () => player.scene.quality.applied,
  draw: (time) => {
    player.timeline.seek(time);
    const view = player.scene.render().getContext("webgl2");
    view.readPixels(0, 0, 1, 1, view.RGBA, view.UNSIGNED_BYTE, new Uint8Array(4)); // waits until it is drawn
  },
  picture: (time, width, kind) => { player.timeline.seek(time); player.place(); return player.camera.take(width).toDataURL(kind, 0.9); },
} });
document.body.dataset.ready = "true";

// Shows what the server sends, and says so when the server has gone.
function follow() {
  const stream = new WebSocket(`ws://${location.host}/stream`);
  let linked = false; // what the address says is meant for the first result, not for those that follow
  stream.onmessage = (message) => {
    const sent = JSON.parse(message.data);
    if (sent.tell !== undefined) player.busy.say(sent.tell);
    if (sent.show === undefined) return;
    player.busy.end();
    results.load(sent.show);
    if (sent.show.autoplay) player.timeline.play();
    if (sent.show.autoplay && !linked) {
      linked = true;
      player.link.follow();
    }
    document.body.dataset.shown = String(Number(document.body.dataset.shown || 0) + 1);
  };
  stream.onclose = () => {
    player.busy.end();
    $("about").textContent = "the viewer's program has ended; this page keeps what it has";
  };
}
