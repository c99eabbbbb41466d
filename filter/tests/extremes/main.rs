//! How far the filter's arithmetic can be trusted at its extremes: each case next to an f64 reference.
//!
//! `cargo test --release -p tactile-filter --features experiments --test extremes -- --nocapture` prints each case; with
//! `TACTILE_LARGEST=1` up to a million particles, ten thousand parts and ten thousand actions (three minutes).

mod between;
mod case;
mod cases;
mod choice;
mod evidence;
mod left_out;
mod odds;
mod place;
mod placed;
mod production;
mod reference;
mod sample;
mod scene;

use case::{Case, Group};

/// What the library refuses, whichever crate says so.
type Result<T> = std::result::Result<T, Box<dyn std::error::Error>>;

/// The cases of a group. `quick`: 10,000 particles, 1,000 parts and 1,000 chained actions at most.
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

#[test]
fn every_case_is_as_expected() {
    let quick = std::env::var_os("TACTILE_LARGEST").is_none();
    for group in Group::ALL {
        for case in of_group(group, 1, quick).unwrap() {
            println!("{case}");
            assert!(case.group == group && case.holds, "{case}");
            assert!(case.refused.is_some() || !case.source.is_empty(), "no source of a bound: {case}");
        }
    }
}
