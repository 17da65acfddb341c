"""The report's style sheet; colours are variables, so that the drawings follow light and dark, too."""

STYLE = """
:root {
  color-scheme: light dark;
  --page: #f6f7f9; --card: #ffffff; --edge: #dfe3e8; --text: #1b2330; --soft: #5d6878; --accent: #1d6fd8;
  --good: #17824b; --good-back: #e2f4ea; --bad: #b3261e; --bad-back: #fbe6e4; --warn-back: #fdf3d8; --warn: #7a5b00;
  --land: #eef1ea; --building: #d9d6cf; --walk: #dcdfe3; --road: #aeb5be; --route: #1d6fd8; --drive: #14202f;
  --mark: #c62828; --mark-text: #ffffff; --bar: #dbe8fb;
}
@media (prefers-color-scheme: dark) {
  :root {
    --page: #12161c; --card: #1a2029; --edge: #2c3541; --text: #e6eaf0; --soft: #98a4b3; --accent: #6aa9ff;
    --good: #5fd396; --good-back: #143325; --bad: #ff8a80; --bad-back: #3d1b1a; --warn-back: #37300f; --warn: #f2d478;
    --land: #171d1b; --building: #2d3138; --walk: #2a313a; --road: #47515d; --route: #6aa9ff; --drive: #f4f6f9;
    --mark: #ff6f61; --mark-text: #1b0f0e; --bar: #20344f;
  }
}
* { box-sizing: border-box; }
body { margin: 0; background: var(--page); color: var(--text); font: 15px/1.5 system-ui, sans-serif; }
main { max-width: 1120px; margin: 0 auto; padding: 28px 20px 60px; }
h1 { font-size: 1.6rem; margin: 0 0 2px; overflow-wrap: anywhere; }
h2 { font-size: 1.15rem; margin: 34px 0 12px; }
h3 { font-size: 1.05rem; margin: 0; overflow-wrap: anywhere; }
p { margin: 0 0 10px; }
a { color: var(--accent); text-decoration: none; }
a:hover { text-decoration: underline; }
.soft { color: var(--soft); }
.small { font-size: .86rem; }
.mono { font-family: ui-monospace, monospace; font-size: .86em; overflow-wrap: anywhere; }
.note { background: var(--warn-back); color: var(--warn); border-radius: 8px; padding: 10px 14px; margin-top: 14px; }
.tiles { display: grid; grid-template-columns: repeat(auto-fit, minmax(150px, 1fr)); gap: 12px; margin-top: 20px; }
.card, .tile { background: var(--card); border: 1px solid var(--edge); border-radius: 10px; }
.tile { padding: 12px 16px; }
.tile b { display: block; font-size: 1.75rem; line-height: 1.25; font-weight: 650; font-variant-numeric: tabular-nums; }
.tile.main b { color: var(--accent); }
.wide { overflow-x: auto; }
table { border-collapse: collapse; width: 100%; font-variant-numeric: tabular-nums; }
th, td { text-align: left; padding: 8px 12px; border-bottom: 1px solid var(--edge); vertical-align: top; }
tr:last-child > td { border-bottom: 0; }
th { color: var(--soft); font-weight: 550; font-size: .86rem; white-space: nowrap; }
.wide td:last-child { min-width: 9rem; }
td:first-child a { white-space: nowrap; }
.num { text-align: right; white-space: nowrap; }
.bar { background: linear-gradient(to right, var(--bar) var(--share), transparent var(--share)); }
.pill { display: inline-block; border-radius: 99px; padding: 1px 10px; font-size: .86rem; white-space: nowrap; }
.pill.good { background: var(--good-back); color: var(--good); }
.pill.bad { background: var(--bad-back); color: var(--bad); }
.drive { margin-top: 18px; padding: 16px; }
.head { display: flex; flex-wrap: wrap; gap: 6px 14px; align-items: center; margin-bottom: 8px; }
.facts { display: flex; flex-wrap: wrap; gap: 2px 22px; margin: 0 0 12px; }
.facts span { white-space: nowrap; }
.pair { display: grid; grid-template-columns: minmax(0, 3fr) minmax(0, 2fr); gap: 16px; }
figure { margin: 0; }
figcaption { color: var(--soft); font-size: .86rem; margin-top: 4px; }
svg { display: block; width: 100%; height: auto; border-radius: 8px; }
svg.map { background: var(--land); }
.drive.scatter { max-width: 420px; }
.note-below { margin-top: 24px; }
svg.chart { margin-bottom: 10px; }
svg text { font-family: system-ui, sans-serif; }
.events { margin: 12px 0 0; padding: 0; list-style: none; max-height: 420px; overflow-y: auto; }
.events li { display: grid; grid-template-columns: 26px minmax(0, 1fr); gap: 0 8px; padding: 6px 0;
  border-bottom: 1px solid var(--edge); }
.events li:last-child { border-bottom: 0; }
.dot { display: inline-block; width: 22px; height: 22px; border-radius: 50%; background: var(--mark);
  color: var(--mark-text); text-align: center; font: 600 12px/22px system-ui, sans-serif; }
.events p { margin: 0; overflow-wrap: anywhere; }
.sheet { margin-top: 14px; }
.sheet img { display: block; width: 100%; height: auto; border-radius: 8px; background: #000; }
details { margin-top: 10px; }
summary { cursor: pointer; color: var(--soft); }
pre { white-space: pre-wrap; overflow-wrap: anywhere; font-size: .82rem; margin: 8px 0 0; }
@media (max-width: 760px) {
  main { padding: 18px 12px 40px; }
  .pair { grid-template-columns: minmax(0, 1fr); }
  .tiles { grid-template-columns: repeat(2, minmax(0, 1fr)); }
  .tile b { font-size: 1.4rem; }
  h1 { font-size: 1.25rem; }
  th, th.num { white-space: normal; }
  th, td { padding: 7px 9px; }
}
@media print { body { background: #fff; } .drive { break-inside: avoid; } }
"""
