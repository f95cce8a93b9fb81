// Start, or say why not.
function start() {
  const payload = JSON.parse($("payload").textContent);
  const player = new Player(), results = payload.studio ? null : new Results(player);
  if (payload.runs.length) {
    results.load(payload);
    if (payload.autoplay && !STILL.matches) player.timeline.play();
    player.link.follow();
  } else {
    $("title").textContent = payload.title;
    $("about").textContent = payload.about;
    player.timeline.enable(false);
  }
  if (payload.live) follow(player, results);
  if (payload.studio) new Studio(player, `ws://${location.host}/studio${location.search}`);
  document.body.dataset.ready = "true";
}

// Live: the page shows what its server sends, and says so when the server has gone.
function follow(player, results) {
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

start();
