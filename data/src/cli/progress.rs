//! How far a command has come: a bar on a terminal, a plain line every tenth elsewhere.

use std::cell::Cell;
use std::io::IsTerminal;

use indicatif::{ProgressBar, ProgressStyle};

/// A listener for `(done, total)`, both in `unit`, that reports on stderr.
pub fn reporter(unit: &'static str) -> impl Fn(usize, usize) {
    let bar = std::io::stderr().is_terminal().then(ProgressBar::no_length);
    if let (Some(bar), Ok(style)) = (&bar, ProgressStyle::with_template("{wide_bar} {pos}/{len} {msg} {per_sec} {eta}"))
    {
        bar.set_style(style);
        bar.set_message(unit);
    }
    let tenths_shown = Cell::new(0);
    move |done, total| match &bar {
        Some(bar) => {
            bar.set_length(total as u64);
            bar.set_position(done as u64);
            if done == total {
                bar.finish_and_clear();
            }
        }
        None => {
            let tenths = 10 * done / total.max(1);
            if tenths > tenths_shown.replace(tenths) {
                eprintln!("{done}/{total} {unit}");
            }
        }
    }
}
