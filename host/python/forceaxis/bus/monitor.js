"use strict";
const terminal = document.getElementById("terminal");
terminal.dataset.sessionWebsocketUrl = `ws://${location.host}/ws`;
// The screen needs 60 columns; a character is 0.6 of the font's size wide.
terminal.dataset.fontSize = Math.max(7, Math.min(16, Math.floor((innerWidth - 20) / 60 / 0.6)));
document.querySelector("#ended button").addEventListener("click", () => location.reload());

// The terminal measures its font when it opens, on window.onload: the font comes first.
let loaded = false;
addEventListener("load", () => (loaded = true));
document.fonts.load('16px "Roboto Mono"').finally(() => {
  const script = document.createElement("script");
  script.src = "/static/js/textual.js";
  script.addEventListener("load", () => loaded && window.onload());
  document.head.append(script);
});
