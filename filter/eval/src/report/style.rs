//! The page's style: light and dark, wide and narrow, screen and print.

/// CSS of the page. Colours are Okabe and Ito's, told apart by colour-blind readers too; the actions have
/// the colours, the inference the dash and the fill, and each action its own mark.
pub const CSS: &str = r#"
:root { color-scheme: light dark; --page: #fff; --ink: #1b1e23; --soft: #5c636e; --faint: #d9dde3; --panel: #f5f6f8;
  --information: #0072b2; --paper-rule: #c24e00; --random: #007a5a; --moco: #9a4f83; --pixel: #a66f00;
  --print: #c7362b; --bar: #1f7fd6; }
@media (prefers-color-scheme: dark) { :root { --page: #14171b; --ink: #e8eaee; --soft: #a2a9b4; --faint: #3a404a;
  --panel: #1d2127; --information: #56b4e9; --paper-rule: #f08a4b; --random: #35c296; --moco: #d99ac4; --pixel: #e6a935;
  --print: #ff7b6e; --bar: #4ba0ee; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 28px 20px 60px; max-width: 1120px; background: var(--page); color: var(--ink);
  font: 16px/1.5 system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.8rem; line-height: 1.2; margin: 0 0 8px; }
h2 { font-size: 1.3rem; margin: 44px 0 6px; }
h3 { font-size: 1.05rem; margin: 30px 0 2px; }
h4 { font-size: 1rem; margin: 20px 0 0; }
p { max-width: 46rem; margin: 6px 0; }
figure { margin: 0; }
figcaption, .note { color: var(--soft); font-size: .88rem; max-width: 46rem; }
figcaption { margin: 8px 0 14px; }
.contents { position: sticky; top: 0; z-index: 2; display: flex; gap: 0 20px; overflow-x: auto; margin: 22px -20px 0; padding: 9px 20px;
  background: var(--page); border-bottom: 1px solid var(--faint); font-size: .88rem; white-space: nowrap; scrollbar-width: none; }
.contents a { color: var(--soft); text-decoration: none; } .contents a:hover { color: var(--ink); text-decoration: underline; }
section { scroll-margin-top: 44px; } section > h2 { margin-top: 36px; }
.tiles { display: flex; flex-wrap: wrap; gap: 12px; margin: 20px 0; }
.tile { flex: 1 1 140px; background: var(--panel); border-radius: 8px; padding: 12px 14px; font-size: .88rem; line-height: 1.35; color: var(--soft); }
.tile b { display: block; font-size: 1.4rem; line-height: 1.4; color: var(--ink); white-space: nowrap; }
.caution { border-left: 3px solid var(--paper-rule); padding: 2px 0 2px 12px; margin: 12px 0; font-size: .92rem; }
.scroll { overflow-x: auto; }
table { border-collapse: collapse; font-variant-numeric: tabular-nums; font-size: .92rem; }
th, td { text-align: right; padding: 4px 12px; white-space: nowrap; vertical-align: top; }
th:first-child, td:first-child { text-align: left; padding-left: 0; white-space: normal; }
thead th { border-bottom: 1px solid var(--soft); }
tr.group th { padding-top: 14px; color: var(--soft); font-weight: 600; }
tr.ours td { font-weight: 600; }
td small { display: block; font-weight: 400; color: var(--soft); font-size: .78rem; }
.legend { display: flex; flex-wrap: wrap; gap: 4px 20px; margin: 10px 0 0; padding: 0; list-style: none; font-size: .88rem; }
.sortable td:first-child { white-space: nowrap; }
.sortable th { vertical-align: bottom; white-space: normal; }
.sortable th button { all: unset; cursor: pointer; }
.sortable th button:hover { text-decoration: underline; } .sortable th button:focus-visible { outline: 2px solid var(--bar); }
.sortable [aria-sort] button::after { content: " ▲"; font-size: .7em; } .sortable [aria-sort="descending"] button::after { content: " ▼"; }
.legend li { display: flex; align-items: center; gap: 7px; }
.key { width: 30px; height: 14px; flex: none; }
.charts { display: grid; grid-template-columns: repeat(3, 1fr); gap: 8px 18px; }
.charts .legend { flex-direction: column; margin: 12px 0 0; padding-left: 38px; }
.charts.two { grid-template-columns: 1fr 2fr; } .charts.and-table { grid-template-columns: 1fr 1fr max-content; } .charts > .scroll { align-self: center; }
.charts th, .charts td { padding: 3px 9px; } .charts td { white-space: nowrap; } .charts td small { display: inline; margin-left: 8px; }
.charts p { font-weight: 600; font-size: .9rem; margin: 10px 0 0; }
.charts svg:not(.key) { display: block; width: 100%; height: auto; }
svg text { font: 13px system-ui, "DejaVu Sans", sans-serif; fill: var(--soft); }
svg .end { text-anchor: end; } svg .middle { text-anchor: middle; }
svg .grid { stroke: var(--faint); stroke-width: 1; fill: none; }
svg .grid.nought { stroke: var(--soft); } .diagonal { stroke: var(--soft); stroke-dasharray: 5 4; stroke-width: 1.5; fill: none; }
svg .dot { fill: currentColor; fill-opacity: .75; stroke: var(--page); stroke-width: 1; }
svg .line { fill: none; stroke: currentColor; stroke-width: 2; stroke-linejoin: round; }
.reference .line { display: none; }
svg .band { fill: currentColor; opacity: .13; }
svg .bar { stroke: currentColor; stroke-width: 1.5; fill: none; }
svg .mark { fill: currentColor; stroke: currentColor; stroke-width: 1.5; }
.particle .line { stroke-dasharray: 5 3; } .particle .mark, .reference .mark { fill: var(--page); }
.information { color: var(--information); } .paper-rule { color: var(--paper-rule); } .random { color: var(--random); }
.moco { color: var(--moco); } .pixel { color: var(--pixel); } .reference { color: var(--ink); }
.right { color: var(--random); } .wrong { color: var(--print); }
dl { display: grid; grid-template-columns: max-content 1fr; gap: 4px 18px; font-size: .92rem; }
dt { color: var(--soft); } dd { margin: 0; overflow-wrap: anywhere; }
code { font-size: .88em; }
summary { cursor: pointer; margin-top: 24px; }
@media (max-width: 640px) {
  body { padding: 18px 14px 40px; font-size: 15px; }
  h1 { font-size: 1.45rem; }
  .contents { margin: 16px -14px 0; padding: 9px 14px; }
  .tiles { display: grid; grid-template-columns: repeat(2, minmax(0, 1fr)); gap: 8px; }
  .tile b { font-size: 1.2rem; white-space: normal; }
  th, td { padding: 4px; } td small { font-size: .68rem; letter-spacing: -.02em; }
  .sortable { font-size: .78rem; } .sortable th, .sortable td { padding: 4px 3px; } .sortable td:first-child { white-space: normal; }
  .charts, .charts.two, .charts.and-table { grid-template-columns: minmax(0, 1fr); } .charts .legend { order: -1; margin: 8px 0 0; padding: 0; }
  dl { grid-template-columns: 1fr; gap: 0; } dd { margin-bottom: 8px; }
}
@media print {
  :root { color-scheme: light; --page: #fff; --ink: #000; --soft: #444; --faint: #ccc; --panel: #f4f4f4;
    --information: #0072b2; --paper-rule: #c24e00; --random: #007a5a; --moco: #9a4f83; --pixel: #a66f00;
    --print: #c7362b; --bar: #1f7fd6; }
  * { print-color-adjust: exact; -webkit-print-color-adjust: exact; }
  body { max-width: none; padding: 0; font-size: 10.5pt; }
  .tiles { display: grid; grid-template-columns: repeat(6, minmax(0, 1fr)); gap: 8px; } .tile { padding: 8px; } .tile b { font-size: 1rem; }
  svg text { font-size: 16px; }
  h2, h3, h4 { break-after: avoid; } figure, table, .tiles { break-inside: avoid; }
  details, .contents { display: none; }
}
"#;
