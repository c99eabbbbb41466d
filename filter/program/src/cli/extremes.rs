//! `tactile-filter extremes`.

use clap::Args;
use tactile_eval::extremes::{Case, Extremes, Group, html, run};
use tactile_eval::{Error, Result};

use super::arguments::{Output, to_json};

/// Drive the filter's arithmetic to its extremes; write extremes.json and extremes.html.
///
/// Fails where a case is not as expected. Times are reported and not judged.
#[derive(Args)]
#[command(after_help = "Example:\n  tactile-filter extremes --out extremes")]
pub struct ExtremesArgs {
    #[command(flatten)]
    output: Output,
    /// Smaller largest cases: seconds instead of minutes
    #[arg(long)]
    quick: bool,
    /// Seed of every random draw
    #[arg(long, default_value_t = 1)]
    seed: u64,
}

impl ExtremesArgs {
    /// Runs the command.
    pub fn run(self) -> Result<()> {
        let _locks = self.output.prepare("extremes.html", "extremes.json", &[])?;
        let extremes = run(self.seed, self.quick, &mut |group| eprintln!("extremes: {}", group.title()))?;
        let page = self.output.write("extremes.html", &html(&extremes))?;
        let json = to_json("extremes", &extremes)?;
        self.output.write("extremes.json", &json)?;
        self.output.print(&json, &page, || print_summary(&extremes));
        match extremes.n_failed() {
            0 => Ok(()),
            n => Err(Error::invalid("extremes", "every case within its bound", format!("{n} that are not"))),
        }
    }
}

fn print_summary(extremes: &Extremes) {
    for group in Group::ALL {
        let cases: Vec<&Case> = extremes.cases.iter().filter(|case| case.group == group).collect();
        let n_refused = cases.iter().filter(|case| case.refused.is_some()).count();
        let n_held = cases.iter().filter(|case| case.holds).count();
        let refused = if n_refused > 0 { format!(", {n_refused} of them refused") } else { String::new() };
        let n_says_nothing = cases.iter().filter(|case| case.says_nothing).count();
        let nothing = if n_says_nothing > 0 {
            format!(", {n_says_nothing} with a bound that says nothing: > 1")
        } else {
            String::new()
        };
        println!("  {:30} {n_held:3} of {:3} as expected{refused}{nothing}", group.title(), cases.len());
        for case in cases.iter().filter(|case| !case.holds) {
            let at = case.at.map_or(String::new(), |at| format!(" at {at:e} {}", group.axis()));
            println!(
                "    not: {}{at}: expected {}, error {:?}, bound {:?}",
                case.variant, case.expected, case.error, case.bound
            );
        }
    }
    for timing in &extremes.timings {
        let target = timing.target_ms.map_or(String::new(), |[half, most]| format!(" (aimed at {half}/{most})"));
        println!(
            "  {:44} ms p50/p99: {:.2}/{:.2}{target}, {} times",
            timing.what, timing.p50_ms, timing.p99_ms, timing.n
        );
    }
}
