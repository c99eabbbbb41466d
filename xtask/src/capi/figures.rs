//! What the library costs, next to what it may cost.

use std::path::Path;

use crate::error::{Error, Result};

/// Names that `tests/figures.c` prints, what they are, and the most that is allowed.
const FIGURES: [(&str, &str, Option<f64>); 11] = [
    ("load_ms", "load model and bank, median, ms", Some(100.0)),
    ("load_cpu_ms", "the same, processor time, ms", None),
    ("first_load_ms", "the same, the first time in a process, ms", None),
    ("resident_after_load_mib", "resident after that, MiB", None),
    ("resident_mib", "resident after 200 touches, MiB", Some(60.0)),
    ("peak_resident_mib", "resident at most, MiB", None),
    ("submit_us", "submit a touch, median, us", None),
    ("submit_p99_us", "submit a touch, 99 of 100, us", None),
    ("poll_us", "poll, median, us", None),
    ("poll_p99_us", "poll, 99 of 100, us", None),
    ("touch_to_decision_ms", "from submit to the polled decision, median, ms", None),
];

/// The largest shared library allowed, MB.
const MAX_LIBRARY_MB: f64 = 6.0;

/// Prints the figures of a run of `tests/figures.c`. One above its target is marked and is no error: it depends on the machine.
pub fn report(text: &str, shared: &Path) -> Result<()> {
    let bytes = std::fs::metadata(shared).map_err(Error::io(shared))?.len();
    println!("{}", line("shared library, stripped, MB", bytes as f64 / 1e6, Some(MAX_LIBRARY_MB)));
    println!("bank of {} parts", value(text, "n_parts")?);
    for (name, what, most) in FIGURES {
        println!("{}", line(what, value(text, name)?, most));
    }
    Ok(())
}

fn line(what: &str, got: f64, most: Option<f64>) -> String {
    let target =
        most.map_or(String::new(), |most| format!("  (target {most}{})", if got > most { ": MISSED" } else { "" }));
    format!("{what:<50}{got:>8.1}{target}")
}

fn value(text: &str, name: &str) -> Result<f64> {
    let find = |line: &str| line.strip_prefix(name)?.trim().parse().ok();
    text.lines().find_map(find).ok_or_else(|| Error::invalid("figures", format!("a line `{name} NUMBER`"), "none"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_figure_above_its_target_is_marked() {
        assert!(line("a", 100.0, Some(100.0)).ends_with("100.0  (target 100)"));
        assert!(line("a", 100.1, Some(100.0)).ends_with("(target 100: MISSED)"));
        assert!(line("a", 1.0, None).ends_with("1.0"));
        assert_eq!(value("n_parts 12\nload_ms 3.5\n", "load_ms").ok(), Some(3.5));
        assert!(value("first_load_ms 1", "load_ms").is_err());
    }
}
