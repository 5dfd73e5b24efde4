"use strict";
const all = (query) => [...document.querySelectorAll(query)];
const by = (id) => document.getElementById(id);

const list = document.createElement("ul");
for (const heading of all("h2[id], #axis ~ h3[id^=model_]")) {
  const item = list.appendChild(document.createElement("li"));
  const link = item.appendChild(document.createElement("a"));
  link.href = "#" + heading.id;
  link.textContent = heading.textContent;
}
by("contents").append(list);

const runs = all("details.run");
const cards = new Map(all(".card").map((card) => [card.dataset.of, card]));
const texts = new Map(runs.map((run) =>
  [run, (run.textContent + cards.get(run.dataset.id).textContent).toLowerCase()]));
function filter() {
  const words = by("text").value.toLowerCase().split(/\s+/);
  const status = by("status").value;
  let shown = 0;
  for (const run of runs) {
    const found = (!status || run.dataset.status === status) && words.every((w) => texts.get(run).includes(w));
    run.hidden = cards.get(run.dataset.id).hidden = !found;
    shown += found;
  }
  by("shown").textContent = `${shown} of ${runs.length}`;
}
document.querySelector(".filter").hidden = false;
document.querySelector(".filter").addEventListener("submit", (event) => event.preventDefault());
by("text").addEventListener("input", filter);
by("status").addEventListener("input", filter);
filter();

by("unfold").addEventListener("click", () => {
  const open = by("unfold").textContent === "unfold";
  for (const run of runs) run.open = open && !run.hidden;
  by("unfold").textContent = open ? "fold" : "unfold";
});

// A link to a heading inside a fold opens the fold.
function reveal() {
  const target = by(decodeURIComponent(location.hash.slice(1)));
  for (let fold = target?.closest("details"); fold; fold = fold.parentElement.closest("details")) fold.open = true;
  target?.scrollIntoView();
}
addEventListener("hashchange", reveal);
reveal();

const large = by("large");
for (const image of all("img.zoom")) {
  image.addEventListener("click", () => {
    large.replaceChildren(image.cloneNode());
    large.classList.remove("closer");
    large.showModal();
  });
}
large.addEventListener("click", (event) =>
  event.target === large ? large.close() : large.classList.toggle("closer"));
