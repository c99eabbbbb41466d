//! How far a command has come: a bar on a terminal, a plain line every tenth elsewhere.

use std::io::IsTerminal;
use std::sync::atomic::{AtomicUsize, Ordering};

use indicatif::{ProgressBar, ProgressStyle};

use crate::text::printable::printable;

/// Progress of one piece of work, on standard error. On a terminal its bar is removed when this is dropped.
#[derive(Debug)]
pub struct Progress {
    /// What is counted: `frames`.
    unit: String,
    bar: Option<ProgressBar>,
    tenths_shown: AtomicUsize,
}

impl Progress {
    /// Begins; `unit` is what is counted, in the plural.
    pub fn new(unit: impl Into<String>) -> Self {
        let unit = unit.into();
        let bar = std::io::stderr().is_terminal().then(ProgressBar::no_length);
        let style = ProgressStyle::with_template("{prefix} {bar:30} {pos}/{len} {eta} left  {msg}");
        if let (Some(bar), Ok(style)) = (&bar, style) {
            bar.set_style(style);
            bar.set_prefix(unit.clone());
        }
        Self { unit, bar, tenths_shown: AtomicUsize::new(0) }
    }

    /// `done` of `total` are done. Threads may report in any order.
    pub fn at(&self, done: usize, total: usize) {
        if self.bar.is_some() {
            return self.on_bar(done, total, "");
        }
        let tenths = 10 * done / total.max(1);
        if tenths > self.tenths_shown.fetch_max(tenths, Ordering::Relaxed) {
            eprintln!("{done}/{total} {}", self.unit);
        }
    }

    /// [`Self::at`] with a few words behind the bar; without a terminal nothing is written.
    pub fn on_bar(&self, done: usize, total: usize, words: &str) {
        if let Some(bar) = &self.bar {
            bar.set_length(total as u64);
            bar.set_position(done as u64);
            bar.set_message(printable(words).into_owned());
        }
    }

    /// Writes a line, above the bar where there is one.
    pub fn line(&self, line: &str) {
        let line = printable(line);
        match &self.bar {
            Some(bar) => bar.println(line),
            None => eprintln!("{line}"),
        }
    }
}

/// A listener for `(done, total)`, both in `unit`.
pub fn reporter(unit: impl Into<String>) -> impl Fn(usize, usize) + Sync {
    let progress = Progress::new(unit);
    move |done, total| progress.at(done, total)
}
