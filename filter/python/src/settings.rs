//! The settings of an episode as one flat list of names, as Python's keyword arguments have them.

use serde_json::{Map, Value};
use tactile_filter::EpisodeConfig;

/// A setting that was refused.
#[derive(Debug, PartialEq)]
pub struct Refused {
    /// Its name.
    pub setting: String,
    /// What would have been right.
    pub expected: String,
    /// What came.
    pub got: String,
}

/// The parts of [`EpisodeConfig`] whose settings are flattened; `None` is the config itself.
const GROUPS: [Option<&str>; 3] = [None, Some("action"), Some("likelihood")];

/// The name of the inference and, where it is the particle filter, of what holds its settings.
const ENGINE: &str = "engine";
const PARTICLE: &str = "particle";

/// All settings by name. A single-precision number has the digits that a person would write.
pub fn flat(config: &EpisodeConfig) -> Result<Map<String, Value>, serde_json::Error> {
    let whole = tree(config)?;
    let mut flat = Map::new();
    for group in GROUPS {
        let Some(fields) = at(&whole, group).as_object() else { continue };
        flat.extend(fields.iter().filter(|(_, value)| !value.is_object()).map(|(k, v)| (k.clone(), v.clone())));
    }
    if let Some(particle) = whole[ENGINE][PARTICLE].as_object() {
        flat.insert(ENGINE.into(), PARTICLE.into());
        flat.extend(particle.clone());
    }
    Ok(flat)
}

/// The same config with some settings changed; all are checked.
pub fn with(config: &EpisodeConfig, mut settings: Vec<(String, Value)>) -> Result<EpisodeConfig, Refused> {
    let mut config = *config;
    // The particle filter's own settings come after the choice of it.
    settings.sort_by_key(|(name, _)| name != ENGINE);
    for (setting, value) in settings {
        config = with_one(&config, &setting, value)?;
    }
    match config.validate() {
        Ok(()) => Ok(config),
        Err(tactile_filter::Error::Config { setting, expected, got }) => {
            // `episode.action.n_draws` is `n_draws` here.
            let setting = setting.rsplit('.').next().unwrap_or_default().to_owned();
            Err(Refused { setting, expected, got })
        }
        Err(other) => {
            Err(Refused { setting: "settings".into(), expected: "valid ones".into(), got: other.to_string() })
        }
    }
}

fn with_one(config: &EpisodeConfig, setting: &str, value: Value) -> Result<EpisodeConfig, Refused> {
    let refused = |expected: String, got: String| Refused { setting: setting.into(), expected, got };
    let internal = |error: serde_json::Error| refused("a setting".into(), error.to_string());
    let mut whole = tree(config).map_err(internal)?;
    let got = value.to_string();
    let holds = |group: &Value| group.get(setting).is_some_and(|old| setting == ENGINE || !old.is_object());
    if setting == ENGINE && value == PARTICLE {
        if !whole[ENGINE].is_object() {
            whole[ENGINE] = Value::Object(Map::from_iter([(PARTICLE.into(), Value::Object(Map::new()))]));
        }
    } else if holds(&whole[ENGINE][PARTICLE]) {
        whole[ENGINE][PARTICLE][setting] = value;
    } else if let Some(group) = GROUPS.into_iter().find(|group| holds(at(&whole, *group))) {
        match group {
            None => whole[setting] = value,
            Some(group) => whole[group][setting] = value,
        }
    } else {
        let names: Vec<String> = flat(config).map_err(internal)?.keys().cloned().collect();
        return Err(refused(format!("one of {}", names.join(", ")), "a setting of another name".into()));
    }
    serde_json::from_value(whole).map_err(|error| {
        // serde says "invalid value: integer `-1`, expected usize".
        let text = error.to_string();
        let expected = text.rsplit_once("expected ").map_or(text.as_str(), |(_, expected)| expected);
        refused(plain(expected).into(), got)
    })
}

/// What a person calls the types of serde's messages.
fn plain(expected: &str) -> &str {
    match expected {
        "usize" | "u64" => "a whole number, not negative",
        "f32" | "f64" => "a number",
        "a boolean" => "True or False",
        other => other,
    }
}

fn at<'a>(whole: &'a Value, group: Option<&str>) -> &'a Value {
    group.map_or(whole, |group| &whole[group])
}

/// Through text, so that 0.01 in single precision is 0.01 and not 0.009999999776482582.
fn tree(config: &EpisodeConfig) -> Result<Value, serde_json::Error> {
    serde_json::from_str(&serde_json::to_string(config)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use serde_json::json;
    use tactile_filter::belief::EngineConfig;
    use tactile_filter::belief::particle::ParticleConfig;
    use tactile_filter::choice::{ActionConfig, ActionRule};
    use tactile_filter::likelihood::LikelihoodConfig;
    use tactile_filter::likelihood::interpolation::Interpolation;

    fn set(settings: &[(&str, Value)]) -> Result<EpisodeConfig, Refused> {
        with(&EpisodeConfig::default(), settings.iter().map(|(name, value)| ((*name).into(), value.clone())).collect())
    }

    #[test]
    fn a_setting_is_found_wherever_it_belongs() {
        let config = set(&[
            ("n_particles", json!(7)),
            ("seed", json!(9)),
            ("stop_place_mm", json!(0.5)),
            ("rule", json!("paper")),
            ("n_finalists", json!(null)),
            ("contact_threshold", json!(0.02)),
            ("temperature", json!(1)),
            ("interpolation", json!("nearest")),
            ("engine", json!("particle")),
        ]);
        let default = EpisodeConfig::default();
        let expected = EpisodeConfig {
            engine: EngineConfig::Particle(ParticleConfig { n_particles: 7, ..ParticleConfig::default() }),
            action: ActionConfig {
                rule: ActionRule::Paper,
                n_finalists: None,
                contact_threshold: 0.02,
                ..default.action
            },
            likelihood: LikelihoodConfig {
                temperature: 1.0,
                interpolation: Interpolation::Nearest,
                ..default.likelihood
            },
            seed: 9,
            stop_place_mm: Some(0.5),
            ..default
        };
        assert_eq!(config, Ok(expected));
    }

    #[test]
    fn all_settings_out_and_in_again_change_nothing() {
        for config in [EpisodeConfig::default(), EpisodeConfig::paper()] {
            let flat = flat(&config).unwrap();
            assert_eq!(flat.contains_key("n_particles"), config.engine != EngineConfig::Exact);
            assert_eq!(with(&EpisodeConfig::default(), flat.into_iter().collect()), Ok(config));
        }
        assert_eq!(flat(&EpisodeConfig::default()).unwrap()["contact_threshold"], json!(0.01));
    }

    #[test]
    fn a_wrong_setting_is_named_with_what_was_expected() {
        let refused = |setting: &str, value: Value| set(&[(setting, value)]).unwrap_err();
        let not_negative = refused("max_touches", json!(-1));
        assert_eq!((not_negative.expected.as_str(), not_negative.got.as_str()), ("a whole number, not negative", "-1"));
        assert_eq!(refused("max_touches", json!(0)).expected, "1 to 1000");
        assert_eq!(refused("temperature", json!("hot")).expected, "a number");
        assert_eq!(refused("between_poses", json!(3)).expected, "True or False");
        assert!(refused("rule", json!("luck")).expected.contains("information"));
        let unknown = refused("temprature", json!(1.0));
        assert!(unknown.setting == "temprature" && unknown.expected.contains("temperature"), "{unknown:?}");
        // A group is no setting, and the particle filter's are none of the exact inference.
        assert!(set(&[("action", json!({}))]).is_err() && set(&[("n_particles", json!(7))]).is_err());
    }
}
