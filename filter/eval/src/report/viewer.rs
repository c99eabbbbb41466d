//! The episodes, one touch at a time. Without its script, or printed, every touch of every episode is shown.

use std::io;

use super::shell::{Section, anchor};
use super::{Board, EpisodeStory, escape, story};

/// Turns the rows of touches into a viewer: one episode and one touch at a time, by buttons, slider and arrow keys.
/// The bars are those of the maps shown.
pub const SCRIPT: &str = r##"<script>
for (const stories of document.querySelectorAll(".stories")) {
  const find = selector => stories.querySelector(selector);
  const episodes = [...stories.querySelectorAll(".episode")], links = [...stories.querySelectorAll(".picker a")];
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
    stories.classList.toggle("live", live);
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
    const step = { ArrowLeft: -1, ArrowRight: 1 }[event.key], { top, bottom } = stories.getBoundingClientRect();
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
</script>
"##;

/// CSS of episodes and their viewer, after the page's own.
pub const CSS: &str = r#"
.picker { display: flex; flex-wrap: wrap; gap: 6px; margin: 14px 0 0; padding: 0; list-style: none; font-size: .85rem; }
.picker a { display: block; border: 1px solid var(--faint); border-radius: 8px; padding: 3px 10px; color: inherit; text-decoration: none; }
.picker a:hover { border-color: var(--soft); } .picker a[aria-current] { border-color: var(--bar); box-shadow: inset 0 0 0 1px var(--bar); }
.picker small { display: block; color: var(--soft); font-size: .74rem; line-height: 1.2; padding-bottom: 2px; }
.controls { display: flex; flex-wrap: wrap; align-items: center; gap: 8px 12px; margin: 12px 0 0; font-size: .88rem; }
.controls[hidden], .controls [hidden] { display: none; }
.controls button { font: inherit; color: var(--ink); background: var(--panel); border: 1px solid var(--faint); border-radius: 8px; padding: 5px 13px; cursor: pointer; }
.controls button:hover:enabled { border-color: var(--soft); } .controls button:disabled { opacity: .4; cursor: default; }
.controls .slider { flex: 1 1 120px; max-width: 340px; accent-color: var(--bar); } .which { min-width: 8.5em; font-weight: 600; }
.bars { display: none; }
.episode { border-top: 1px solid var(--faint); margin-top: 24px; }
.episode h3 { margin-top: 14px; }
.verdict { font-size: .85rem; font-weight: 600; border: 1px solid currentColor; border-radius: 99px; padding: 1px 9px; margin-left: 8px; white-space: nowrap; }
.heads, .touch { display: grid; grid-template-columns: 1.5rem repeat(4, 1fr) 3.6fr; gap: 12px; align-items: start; }
.heads { color: var(--soft); font-size: .8rem; margin: 10px 0 2px; }
.touch { padding: 8px 0; break-inside: avoid; }
.touch + .touch { border-top: 1px dotted var(--faint); }
.count { font-weight: 600; font-size: 1.05rem; }
.pane { min-width: 0; } .pane .head { display: none; color: var(--soft); font-size: .78rem; line-height: 1.25; margin-bottom: 4px; }
.touch img, .where { display: block; width: 100%; height: auto; border-radius: 4px; }
.where, .end-note { background: var(--panel); }
.end-note { border-radius: 4px; padding: 12px; color: var(--soft); font-size: .8rem; }
.part { fill: var(--soft); opacity: .32; }
.print { fill: none; stroke: var(--print); vector-effect: non-scaling-stroke; stroke-width: 1; opacity: .65; }
.print.now { fill: var(--print); fill-opacity: .15; stroke-width: 2; opacity: 1; }
.print.top { stroke-width: 4; opacity: 1; }
.trail { fill: none; stroke: var(--print); vector-effect: non-scaling-stroke; stroke-width: 1; stroke-dasharray: 2 2; opacity: .8; }
.gain circle { fill: var(--random); } .gain .blank { fill: none; stroke: var(--soft); stroke-width: 1; vector-effect: non-scaling-stroke; }
.next, .chosen { fill: none; stroke: var(--bar); stroke-width: 2; vector-effect: non-scaling-stroke; } .next { stroke-dasharray: 5 3; stroke-width: 1.5; }
.belief { min-width: 0; } .said { font-size: .8rem; line-height: 1.35; margin: 0 0 6px; color: var(--soft); } .said b { color: var(--ink); }
.maps { display: grid; grid-template-columns: repeat(6, 1fr); gap: 6px 8px; }
.map { font-size: .76rem; line-height: 1.3; font-variant-numeric: tabular-nums; min-width: 0; }
.map svg { display: block; overflow: visible; width: 100%; height: auto; background: var(--panel); border-radius: 3px; }
.map image { image-rendering: pixelated; }
.map .part { fill: none; stroke: var(--ink); stroke-width: 1; vector-effect: non-scaling-stroke; opacity: .5; }
.map .name { display: flex; justify-content: space-between; color: var(--soft); }
.map.true .name { color: var(--print); font-weight: 700; }
.ring { fill: none; stroke: var(--print); stroke-width: 2; vector-effect: non-scaling-stroke; }
.share { height: 4px; border-radius: 2px; background: var(--faint); }
.share i { display: block; height: 4px; border-radius: 2px; background: var(--bar); }
.defs { position: absolute; width: 0; height: 0; }
@media screen {
  .live .episode:not(.now), .live .touch:not(.now), .live .heads, .live .count, .live .map .share { display: none; }
  .live .stage { display: grid; grid-template-columns: 180px minmax(0, 1fr); gap: 0 28px; align-items: start; margin-top: 14px; }
  .live .episode { border: 0; margin: 0; } .live .episode h3 { margin-top: 0; }
  .live .touch { grid-template-columns: repeat(4, 1fr); gap: 14px; border: 0; }
  .live .maps { grid-template-columns: repeat(auto-fill, minmax(96px, 1fr)); } .live .pane .head { display: block; } .live .belief { grid-column: 1 / -1; } .live .said { font-size: .92rem; max-width: none; }
  .live .touch img, .live .where { aspect-ratio: 1; object-fit: contain; background: var(--panel); }
  .live .bars { display: block; font-size: .85rem; font-variant-numeric: tabular-nums; } .live .bars p { color: var(--soft); font-size: .78rem; margin: 0 0 6px; }
  .class { display: grid; grid-template-columns: minmax(1.6em, max-content) 1fr 3em; gap: 8px; align-items: center; line-height: 1.55; }
  .class > span:first-child { overflow: hidden; text-overflow: ellipsis; max-width: 6em; } .class > span:last-child { text-align: right; color: var(--soft); }
  .class .share, .class .share i { height: 11px; } .class .share i { width: 0; transition: width .35s; }
  .class.true > span { color: var(--print); font-weight: 700; }
}
@media (prefers-reduced-motion: reduce) { .class .share i { transition: none; } }
@media screen and (max-width: 640px) {
  .heads { display: none; }
  .touch, .live .touch { grid-template-columns: 1fr 1fr; gap: 8px; } .pane .head { display: block; }
  .count, .belief { grid-column: 1 / -1; }
  .count::before { content: "Touch "; }
  .live .stage { grid-template-columns: minmax(0, 1fr); gap: 12px; }
  .live .bars { display: grid; grid-template-columns: 1fr 1fr; gap: 0 18px; } .live .bars p { grid-column: 1 / -1; }
  .maps, .live .maps { grid-template-columns: repeat(4, 1fr); }
  .picker { display: grid; grid-template-columns: 1fr 1fr; font-size: .8rem; } .picker a { height: 100%; padding: 3px 8px; }
  .controls { gap: 8px; } .controls button { padding: 5px 10px; } .which { min-width: 0; order: -1; flex-basis: 100%; }
  .controls .slider { order: 5; flex-basis: 100%; max-width: none; }
}
@media print { .picker, .controls, .how { display: none; } .heads { break-after: avoid; } }
"#;

/// The episodes of a report; nothing where none is told.
pub fn section(board: &Board, episodes: &[EpisodeStory]) -> io::Result<Option<Section>> {
    if episodes.is_empty() {
        return Ok(None);
    }
    let told = episodes.iter().map(|episode| story::section(episode, board)).collect::<io::Result<String>>()?;
    let links: String = episodes.iter().map(|episode| link(episode, board)).collect();
    let body = format!(
        r#"{}<div class="stories"><p class="how" hidden>
Pick an episode and go through its touches with the buttons, the slider or the arrow keys ← and →: where it touched,
what it felt, what it then believed, and why it went on where it did.</p>
<ol class="picker">{links}</ol>
<div class="controls" hidden><button type="button" class="back">← Previous</button><input type="range" class="slider" min="1" value="1" aria-label="Touch"><button type="button" class="on">Next →</button><output class="which"></output><button type="button" class="all"></button></div>
<div class="stage"><div class="bars"><p>Probability of each part; red is the truth</p></div><div>{told}</div></div></div>
<figure><figcaption><b>Where it touched:</b> the true part in grey; red, what the sensor covered, the newest filled, with its
upper edge thick. <b>What the camera saw,</b> and <b>what changed</b> from the sensor at rest, strengthened: grey is
no change. <b>Where next, and why:</b> the likeliest part, and on it, red, where the filter thinks the sensor stands.
A dot is a place to touch next, the larger and stronger the more its best angle is expected to tell, on a scale of
each touch’s own; a small hollow one is expected to show no edge. Blue: the place chosen and what the sensor would
cover there. A <b>nat</b> measures what is told: 0.69 nats are one yes or no. These are the filter’s own expectations,
estimated from states drawn from its belief; dots beside the best few are rougher estimates from fewer draws. <b>Where
the first touch was:</b> a map for each part; the stronger the blue, the more probable the place, on one scale for the
touch. The number is the part’s whole probability. The red ring is the truth: watch the blue gather in it. Above the
maps, the likeliest part and its <b>fit:</b> how well it explains what was felt, higher is better, 0 is as well as the
best recorded view of any part. To be confident the filter must be sure of a part that fits; a part that is likely
because the others fit even worse is none of these parts.</figcaption></figure>
"#,
        story::outlines(board)
    );
    Ok(Some(Section::new("Episodes", "Episodes, touch by touch", body)))
}

/// An episode in the list: what it is called, the truth and how it came out.
fn link(episode: &EpisodeStory, board: &Board) -> String {
    let (class, verdict) = story::verdict(episode);
    let n = episode.touches.len();
    format!(
        r##"<li><a href="#{}">{}: <b>{}</b> <span class="{class}">{verdict}</span><small>{n} {}, {}</small></a></li>"##,
        anchor(&episode.name),
        escape(&episode.name),
        escape(&board.parts[episode.truth].name),
        if n == 1 { "touch" } else { "touches" },
        escape(&episode.why),
    )
}
