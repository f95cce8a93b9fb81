// Start, or say why not.
function start() {
  const payload = JSON.parse($("payload").textContent);
  const player = new Player(), choices = payload.choices || [payload];
  if (choices[0].runs.length) {
    player.load({ meshes: payload.meshes, ...choices[0] });
    listChoices(player, choices, payload.meshes);
    if (payload.autoplay && !STILL.matches) player.timeline.play();
    player.link.follow();
  } else {
    $("title").textContent = payload.title;
    $("about").textContent = payload.about;
    player.timeline.enable(false);
  }
  if (payload.live) follow(player);
  if (payload.studio) new Studio(player, `ws://${location.host}/studio${location.search}`);
  document.body.dataset.ready = "true";
}

// Results to choose from: what is chosen is shown as the one before was, at the same time.
function listChoices(player, choices, meshes) {
  const choose = $("choose");
  choose.hidden = choices.length < 2;
  $("title").hidden = !choose.hidden;
  options(choose, choices.map(({ title }, k) => [k, title]));
  choose.addEventListener("change", () => {
    const shown = new URLSearchParams(player.state().filter(([, value]) => value !== "" && value !== null));
    player.load({ meshes, ...choices[choose.value] });
    player.become(shown);
  });
}

// Live: the page shows what its server sends, and says so when the server has gone.
function follow(player) {
  const stream = new WebSocket(`ws://${location.host}/stream`);
  let linked = false; // what the address says is meant for the first result, not for those that follow
  stream.onmessage = (message) => {
    const sent = JSON.parse(message.data);
    if (sent.tell !== undefined) player.busy.say(sent.tell);
    if (sent.show === undefined) return;
    player.busy.end();
    player.load(sent.show);
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
