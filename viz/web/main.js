// Start, or say why not.
function start() {
  const payload = JSON.parse($("payload").textContent);
  let player;
  try {
    player = new Player();
  } catch (fault) {
    $("stage").replaceChildren(element("div", `This browser cannot draw in three dimensions (WebGL): ${fault.message}`, "fault"));
    return;
  }
  if (payload.runs.length) {
    player.load(payload);
    if (payload.autoplay && !window.matchMedia("(prefers-reduced-motion: reduce)").matches) player.play();
    player.hash();
  } else {
    player.payload = null;
    $("title").textContent = payload.title;
    $("about").textContent = payload.about;
    player.enable(false);
  }
  if (payload.live) follow(player);
  document.body.dataset.ready = "true";
}

// Live: the page shows what its server sends, and says so when the server has gone.
function follow(player) {
  const stream = new WebSocket(`ws://${location.host}/stream`), busy = new Busy();
  stream.onmessage = (message) => {
    const sent = JSON.parse(message.data);
    if (sent.tell !== undefined) busy.say(sent.tell);
    if (sent.show === undefined) return;
    busy.end();
    player.load(sent.show);
    if (sent.show.autoplay) player.play();
    document.body.dataset.shown = String(Number(document.body.dataset.shown || 0) + 1);
  };
  stream.onclose = () => busy.end("the viewer's program has ended; this page keeps what it has");
}

start();
