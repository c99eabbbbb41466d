// Tables whose rows sort by a column when its head is pressed: by the first text of its cells, numbers as numbers,
// what is no number after them; pressed again, in the other order.
for (const table of document.querySelectorAll("table.sortable")) {
  const heads = [...table.tHead.rows[0].cells], body = table.tBodies[0];
  heads.forEach((head, column) => head.firstChild.addEventListener("click", () => {
    const sign = head.getAttribute("aria-sort") === "ascending" ? -1 : 1;
    heads.forEach(other => other.removeAttribute("aria-sort"));
    head.setAttribute("aria-sort", sign > 0 ? "ascending" : "descending");
    const key = row => (row.cells[column].firstChild?.textContent ?? "").trim().replace("−", "-");
    const compare = (a, b) => {
      const [x, y] = [parseFloat(a), parseFloat(b)];
      if (isNaN(x) || isNaN(y)) return isNaN(x) - isNaN(y) || sign * a.localeCompare(b);
      return sign * (x - y);
    };
    body.append(...[...body.rows].sort((a, b) => compare(key(a), key(b))));
  }));
}

// Rows of touches become a viewer: one episode and one touch at a time, by buttons, slider and arrow keys.
// The bars are those of the maps shown.
for (const narratives of document.querySelectorAll(".narratives")) {
  const find = selector => narratives.querySelector(selector);
  const episodes = [...narratives.querySelectorAll(".episode")], links = [...narratives.querySelectorAll(".picker a")];
  const [back, slider, on, count, all, bars] = [".back", ".slider", ".on", ".which", ".all", ".bars"].map(find);
  let episode = episodes[0], touches = [], at = 0, live = true;
  const showTouch = touch => {
    at = Math.min(Math.max(touch, 0), touches.length - 1);
    touches.forEach((row, index) => row.classList.toggle("now", index === at));
    slider.value = at + 1;
    count.textContent = `Touch ${at + 1} of ${touches.length}`;
    back.disabled = at === 0;
    on.disabled = at === touches.length - 1;
    const maps = [...touches[at].querySelectorAll(".map")];
    [...bars.querySelectorAll(".class")].forEach((bar, index) => {
      bar.querySelector("i").style.width = maps[index].querySelector(".share i").style.width;
      bar.lastElementChild.textContent = maps[index].querySelector(".name").lastElementChild.textContent;
    });
  };
  const showEpisode = (chosen, touch) => {
    episode = chosen;
    episodes.forEach(other => other.classList.toggle("now", other === chosen));
    links.forEach(link => link.hash === "#" + chosen.id
      ? link.setAttribute("aria-current", "true") : link.removeAttribute("aria-current"));
    touches = [...chosen.querySelectorAll(".touch")];
    slider.max = touches.length;
    bars.querySelectorAll(".class").forEach(bar => bar.remove());
    for (const map of touches[0].querySelectorAll(".map")) {
      const bar = document.createElement("div"), name = document.createElement("span");
      bar.className = map.classList.contains("true") ? "class true" : "class";
      name.textContent = map.querySelector(".name").firstElementChild.textContent;
      const track = document.createElement("div"), percent = document.createElement("span");
      track.className = "share";
      track.append(document.createElement("i"));
      bar.append(name, track, percent);
      bars.append(bar);
    }
    showTouch(touch);
  };
  const setLive = value => {
    live = value;
    narratives.classList.toggle("live", live);
    all.textContent = live ? "All touches" : "One at a time";
    for (const control of [back, slider, on, count]) control.hidden = !live;
  };
  const fromAddress = () => {
    const named = episodes.find(other => "#" + other.id === location.hash);
    if (named) showEpisode(named, 0);
    return Boolean(named);
  };
  back.addEventListener("click", () => showTouch(at - 1));
  on.addEventListener("click", () => showTouch(at + 1));
  slider.addEventListener("input", () => showTouch(slider.value - 1));
  all.addEventListener("click", () => setLive(!live));
  links.forEach((link, index) => link.addEventListener("click", event => {
    if (!live) return;
    event.preventDefault();
    history.replaceState(null, "", link.hash);
    showEpisode(episodes[index], 0);
  }));
  addEventListener("hashchange", fromAddress);
  addEventListener("keydown", event => {
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key], { top, bottom } = narratives.getBoundingClientRect();
    const elsewhere = event.target.closest?.("input, textarea, select, .scroll, .contents");
    if (!step || !live || elsewhere || event.altKey || event.ctrlKey || event.metaKey || event.shiftKey) return;
    if (top > innerHeight || bottom < 0) return;
    event.preventDefault();
    showTouch(at + step);
  });
  for (const control of [".how", ".controls"]) find(control).hidden = false;
  setLive(true);
  if (!fromAddress()) showEpisode(episodes[0], 0);
}
