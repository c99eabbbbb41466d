//! Numbers of an episode, set by name.

use clap::Args;
use tactile_eval::{Error, Result};
use tactile_filter::belief::EngineConfig;
use tactile_filter::choice::ActionRule;
use tactile_filter::{EpisodeConfig, Number, Settings, TouchModel};

use super::arguments::Engine;

/// How well motions are judged.
const EFFORT: [&str; 3] = ["n_draws", "n_suppositions", "n_finalists"];

/// What only the choice of the next touch looks at, besides [`EFFORT`].
const OF_CHOICE: [&str; 2] = ["travel_nats_per_mm", "min_separation_mm"];

/// The particle filter's own.
const N_PARTICLES: &str = "n_particles";

/// Numbers of an episode.
#[derive(Args)]
pub struct Numbers {
    /// Set a number of the episode, as often as needed; --help lists them
    #[arg(long = "set", value_name = "NAME=VALUE", value_parser = assignment, long_help = names())]
    numbers: Vec<(String, String)>,
}

impl Numbers {
    /// A config with these numbers; that of particles only where there are any.
    pub fn applied_to(&self, mut config: EpisodeConfig) -> Result<EpisodeConfig> {
        let has_particles = matches!(config.method().engine, EngineConfig::Particle(_));
        for (name, text) in self.numbers.iter().filter(|(name, _)| name != N_PARTICLES || has_particles) {
            config.set(name, text)?;
        }
        config.validate()?;
        Ok(config)
    }

    /// Whether a number is set.
    pub fn has(&self, name: &str) -> bool {
        self.numbers.iter().any(|(set, _)| set == name)
    }

    /// Refuses the first of some numbers that is set, though it would do nothing.
    pub fn refuse(&self, names: &[&str], expected: &str, got: &str) -> Result<()> {
        match names.iter().find(|name| self.has(name)) {
            Some(name) => Err(Error::invalid(format!("--set {name}"), expected, got)),
            None => Ok(()),
        }
    }

    /// Refuses what a budget chooses itself.
    pub fn check_budget(&self) -> Result<()> {
        let chosen = [&EFFORT[..], &["subdivisions", "max_touches", N_PARTICLES]].concat();
        self.refuse(&chosen, "no budget, which chooses it", "one")
    }

    /// Refuses what only a choice of touches looks at, where none are chosen.
    pub fn check_no_choice(&self) -> Result<()> {
        let of_choice = [&EFFORT[..], &OF_CHOICE].concat();
        self.refuse(&of_choice, "a command that chooses touches", "one that plays recorded ones")
    }

    /// Refuses what none of some rules looks at.
    pub fn check_rules(&self, rules: &[ActionRule]) -> Result<()> {
        if !rules.iter().any(|rule| matches!(rule, ActionRule::Information | ActionRule::Paper)) {
            self.refuse(&EFFORT, "a rule that judges motions, information or paper", "others alone")?;
        }
        if rules.contains(&ActionRule::Information) {
            return Ok(());
        }
        self.refuse(&["travel_nats_per_mm"], "the rule information", "other rules alone")
    }

    /// Refuses particles where no engine has any.
    pub fn check_engines(&self, engines: &[Engine]) -> Result<()> {
        if engines.iter().any(|engine| *engine != Engine::Exact) {
            return Ok(());
        }
        self.refuse(&[N_PARTICLES], "the engine particle or paper", "exact alone")
    }
}

/// Refuses the first of some flags that is given, though it would do nothing.
pub fn refuse_given(flags: &[(&str, bool)], expected: &str, got: &str) -> Result<()> {
    match flags.iter().find(|(_, is_given)| *is_given) {
        Some((flag, _)) => Err(Error::invalid(*flag, expected, got)),
        None => Ok(()),
    }
}

/// A name and its value.
pub fn assignment(text: &str) -> std::result::Result<(String, String), String> {
    let (name, value) = text.split_once('=').ok_or("expected NAME=VALUE, such as max_touches=4")?;
    Ok((name.trim().to_owned(), value.trim().to_owned()))
}

/// What may be set, for the help.
fn names() -> String {
    let of_user = list(Settings::numbers(), &Settings::default());
    let of_model = list(TouchModel::numbers(), &TouchModel::default());
    format!(
        "Set a number of the episode, as often as needed, such as --set max_touches=4. What a user chooses:\n  {of_user}\n\
         For experiments, what a calibration or a bank measures or what is fixed (default without a calibration):\n  \
         {of_model}\nand n_particles of the engines particle and paper"
    )
}

/// The numbers of a table, each on a line.
fn list<T>(numbers: &[Number<T>], defaults: &T) -> String {
    let line =
        |number: &Number<T>| format!("{} ({}) [default: {}]", number.name, number.allowed(), number.text(defaults));
    numbers.iter().map(line).collect::<Vec<_>>().join("\n  ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn numbers(set: &[&str]) -> Numbers {
        Numbers { numbers: set.iter().map(|text| assignment(text).unwrap()).collect() }
    }

    #[test]
    fn numbers_are_set_by_name() {
        let set =
            numbers(&["max_touches=4", "false_accept = none", "steepness=12.5", "temperature=none", "n_particles=9"]);
        let config = set.applied_to(EpisodeConfig::default()).unwrap();
        let by_hand = EpisodeConfig::default().changed(|settings, model, _| {
            (settings.max_touches, settings.false_accept, model.steepness) = (4, None, 12.5);
        });
        assert_eq!(config, by_hand);
        let EngineConfig::Particle(particle) = set.applied_to(EpisodeConfig::paper()).unwrap().method().engine else {
            panic!("exact")
        };
        assert_eq!(particle.n_particles, 9);
        let refused = |set: &str| numbers(&[set]).applied_to(EpisodeConfig::paper()).unwrap_err().to_string();
        assert!(refused("max_touchs=4").starts_with("episode.max_touchs: expected one of stop_probability, "));
        assert_eq!(refused("steepness=-1"), "touch_model.steepness: expected a positive number, got -1");
        assert_eq!(refused("temperature=-1"), "touch_model.temperature: expected a positive number, or none, got -1");
        assert_eq!(refused("n_particles=0"), "episode.engine.n_particles: expected 1 to 1000000, got 0");
        assert_eq!(refused("n_particles=x"), "episode.engine.n_particles: expected a whole number, got x");
        assert!(assignment("max_touches").is_err());
    }

    #[test]
    fn numbers_that_would_do_nothing_are_refused() {
        let (information, paper, random) = (ActionRule::Information, ActionRule::Paper, ActionRule::Random);
        let draws = numbers(&["n_draws=8"]);
        assert_eq!(
            draws.check_rules(&[random]).unwrap_err().to_string(),
            "--set n_draws: expected a rule that judges motions, information or paper, got others alone"
        );
        draws.check_rules(&[random, paper]).unwrap();
        let travel = numbers(&["travel_nats_per_mm=0.1"]);
        travel.check_rules(&[information, random]).unwrap();
        assert!(travel.check_rules(&[paper]).unwrap_err().to_string().starts_with("--set travel_nats_per_mm"));
        numbers(&[]).check_rules(&[random]).unwrap();
        assert!(travel.check_no_choice().is_err() && draws.check_no_choice().is_err());
        assert!(numbers(&["subdivisions=1"]).check_budget().is_err());
        let particles = numbers(&["n_particles=50"]);
        particles.check_engines(&[Engine::Exact, Engine::Paper]).unwrap();
        let refused = particles.check_engines(&[Engine::Exact]).unwrap_err().to_string();
        assert_eq!(refused, "--set n_particles: expected the engine particle or paper, got exact alone");
    }
}
