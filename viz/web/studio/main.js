// The studio's page.
import { $ } from "../format.js";
import { Player } from "../player.js";
import { Studio } from "./studio.js";

const player = new Player();
player.load(JSON.parse($("payload").textContent)); // the scene as it begins
player.busy.say("simulating the motion");
new Studio(player, `ws://${location.host}/studio${location.search}`);
document.body.dataset.ready = "true";
