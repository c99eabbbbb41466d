//! How far the filter's arithmetic can be trusted at its extremes: each case next to an f64 reference.

mod between;
mod case;
mod cases;
mod choice;
mod evidence;
mod left_out;
mod odds;
mod page;
mod place;
mod placed;
mod plot;
mod production;
mod reference;
mod sample;
mod scene;
mod speed;

use serde::Serialize;

pub use case::{Case, Group};
pub use page::html;
pub use speed::Timing;

use crate::error::Result;

/// The version of the result's layout.
pub const SCHEMA: &str = "tactile-filter/extremes/3";

/// All cases and what was measured of each.
#[derive(Clone, Debug, Serialize)]
pub struct Extremes {
    /// [`SCHEMA`].
    pub schema: String,
    /// Seed of every random draw.
    pub seed: u64,
    /// Whether the largest cases were made smaller.
    pub quick: bool,
    /// The cases, group by group.
    pub cases: Vec<Case>,
    /// How long updates take on this computer, one thread.
    pub timings: Vec<Timing>,
}

impl Extremes {
    /// How many cases are not as expected.
    pub fn n_failed(&self) -> usize {
        self.cases.iter().filter(|case| !case.holds).count()
    }

    /// How many cases have a bound that says nothing.
    pub fn n_says_nothing(&self) -> usize {
        self.cases.iter().filter(|case| case.says_nothing).count()
    }
}

/// Computes every case. `progress` is called with each group that begins.
///
/// `quick`: 10,000 particles, 1,000 parts and 1,000 chained actions at most, and a tenth of the timings.
///
/// # Errors
/// Where the library refuses what it should take; what it should refuse is a case.
pub fn run(seed: u64, quick: bool, progress: &mut dyn FnMut(Group)) -> Result<Extremes> {
    let mut cases = Vec::new();
    for group in Group::ALL {
        progress(group);
        cases.extend(of_group(group, seed, quick)?);
    }
    let timings = speed::timings(seed, quick)?;
    Ok(Extremes { schema: SCHEMA.into(), seed, quick, cases, timings })
}

fn of_group(group: Group, seed: u64, quick: bool) -> Result<Vec<Case>> {
    match group {
        Group::Production => production::cases(seed, quick),
        Group::Precision => production::precisions(seed),
        Group::Choice => choice::cases(seed),
        Group::Steepness => odds::steepnesses(seed),
        Group::Odds => odds::cases(seed),
        Group::Temperature => odds::temperatures(seed),
        Group::Particles => cases::particles(seed, quick),
        Group::Classes => cases::classes(seed, quick),
        Group::Similarity => cases::similarities(),
        Group::Chain => cases::chain(seed, quick),
        Group::Wrap => cases::wrap(seed),
        Group::LeftOut => left_out::cases(seed),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_case_is_as_expected() {
        for group in Group::ALL {
            let cases = of_group(group, 1, true);
            for case in cases.unwrap() {
                assert!(case.group == group && case.holds, "{case:?}");
                assert!(case.refused.is_some() || !case.source.is_empty(), "no source of a bound: {case:?}");
            }
        }
    }
}
