// The studio's page.
import { $ } from "../format.js";
import { Player } from "../player.js";
import { Studio } from "./studio.js";

const player = new Player();
player.wait(JSON.parse($("payload").textContent));
new Studio(player, `ws://${location.host}/studio${location.search}`);
document.body.dataset.ready = "true";
