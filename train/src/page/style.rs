//! The page's style: light and dark, wide and narrow, the colours of the evaluation's report.

/// CSS of the page. Colours are Okabe and Ito's, told apart by colour-blind readers too; dashes and labels say
/// the same without colour.
pub const CSS: &str = r#"
:root { color-scheme: light dark; --page: #fff; --ink: #1b1e23; --soft: #5c636e; --faint: #d9dde3; --panel: #f5f6f8;
  --first: #0072b2; --second: #c24e00; --third: #007a5a; --bad: #c7362b; }
@media (prefers-color-scheme: dark) { :root { --page: #14171b; --ink: #e8eaee; --soft: #a2a9b4; --faint: #3a404a;
  --panel: #1d2127; --first: #56b4e9; --second: #f08a4b; --third: #35c296; --bad: #ff7b6e; } }
* { box-sizing: border-box; }
body { margin: 0 auto; padding: 28px 20px 60px; max-width: 1120px; background: var(--page); color: var(--ink);
  font: 16px/1.5 system-ui, "Segoe UI", Roboto, "DejaVu Sans", sans-serif; }
h1 { font-size: 1.8rem; line-height: 1.2; margin: 0 0 8px; }
h2 { font-size: 1.3rem; margin: 44px 0 6px; }
p { max-width: 46rem; margin: 6px 0; }
.ill { border-left: 4px solid var(--bad); padding-left: 12px; }
.tiles { display: flex; flex-wrap: wrap; gap: 12px; margin: 20px 0; }
.tile { flex: 1 1 140px; background: var(--panel); border-radius: 8px; padding: 12px 14px; font-size: .88rem; line-height: 1.35; color: var(--soft); }
.tile b { display: block; font-size: 1.4rem; line-height: 1.4; color: var(--ink); white-space: nowrap; }
.charts { display: grid; grid-template-columns: repeat(2, minmax(0, 1fr)); gap: 22px 28px; margin-top: 18px; }
figure { margin: 0; } figure p { font-weight: 600; font-size: .95rem; margin: 0; }
figcaption { color: var(--soft); font-size: .88rem; margin: 4px 0 0; }
svg { display: block; width: 100%; height: auto; }
svg text { font: 13px system-ui, "DejaVu Sans", sans-serif; fill: var(--soft); }
svg .end { text-anchor: end; } svg .middle { text-anchor: middle; }
svg .grid { stroke: var(--faint); stroke-width: 1; fill: none; }
svg .reference { stroke: var(--soft); stroke-width: 1.5; stroke-dasharray: 5 4; fill: none; }
svg .line { fill: none; stroke: currentColor; stroke-width: 2; stroke-linejoin: round; }
svg .mark { fill: currentColor; }
svg .label { fill: currentColor; font-weight: 600; }
.first { color: var(--first); } .second { color: var(--second); } .third { color: var(--third); }
.second .line { stroke-dasharray: 7 3; } .third .line { stroke-dasharray: 2 3; }
dl { display: grid; grid-template-columns: max-content 1fr; gap: 4px 18px; font-size: .92rem; }
dt { color: var(--soft); } dd { margin: 0; overflow-wrap: anywhere; font-variant-numeric: tabular-nums; }
@media (max-width: 640px) { body { padding: 18px 14px 40px; font-size: 15px; } h1 { font-size: 1.45rem; }
  .charts { grid-template-columns: minmax(0, 1fr); } dl { grid-template-columns: 1fr; gap: 0; } dd { margin-bottom: 8px; } }
@media print { :root { color-scheme: light; --page: #fff; --ink: #000; --soft: #444; --faint: #ccc; --panel: #f4f4f4;
    --first: #0072b2; --second: #c24e00; --third: #007a5a; --bad: #c7362b; }
  body { max-width: none; padding: 0; font-size: 10.5pt; } figure { break-inside: avoid; } }
"#;
