//! The node's parameters, as a ROS 2 user sets them: a YAML file, `-p name:=value`, or the defaults.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value};
use tactile_data::dataset::store::{Channels, Mirror};
use tactile_data::dataset::touch::Side;
use tactile_data::light::lamps::CalibratedLamps;
use tactile_data::pose::grid::PoseGrid;
use tactile_data::recording::geometry::{Crop, Geometry};
use tactile_data::recording::ros::rigid::Rigid;
use tactile_filter::{EpisodeConfig, Settings};
use tactile_infer::Model;

use crate::error::{Error, Result};

/// A parameter that is the network's and not the node's: of which distribution of ROS 2 the other nodes are.
pub const DISTRIBUTION: &str = "ros_distro";

/// What the node can be set to. Names in ROS have a dot: `camera.crop`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Parameters {
    /// Which side is touched: `hole`, or `peg` for raised parts that are recognised among the bank's own.
    #[serde(skip_serializing_if = "Side::is_hole")]
    pub side: Side,
    /// When a touch is observed.
    pub trigger: Trigger,
    /// Whether the first pictures are taken for the sensor at rest, without being asked.
    pub rest_at_start: bool,
    /// Whether holes that are named with confidence tell how well touches of this sensor match, until the node ends.
    pub learn_sensor: bool,
    /// Seconds that a touch may take to be observed, from the trigger on; 1.0 if not given.
    pub observe_timeout_s: Option<f64>,
    /// The camera.
    pub camera: CameraParameters,
    /// The robot's tool.
    pub tool: ToolParameters,
    /// Where the robot can touch.
    pub reach: ReachParameters,
    /// The filter.
    pub episode: EpisodeParameters,
    /// Names of frames in what is published.
    pub frames: FrameParameters,
}

/// When a touch is observed.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Trigger {
    /// When the service `~/observe` is called.
    #[default]
    Service,
    /// When a contact has settled, once for each contact, and when the service is called. A touch that shows no edge
    /// needs the service: no camera sees it.
    Contact,
}

/// How pictures become frames, and when they are of use.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct CameraParameters {
    /// Order of the colours where an encoding does not say it, or says it wrongly: `bgr` turns what comes round.
    pub channels: Channels,
    /// Quarter turns counter-clockwise, as the picture is looked at; 0..=3.
    pub quarter_turns: u8,
    /// `x` (left and right) or `y` (top and bottom) turns the picture round.
    pub mirror: Option<Mirror>,
    /// `LEFT,TOP,WIDTH,HEIGHT` in pixels, or `border:1/7`; nothing keeps all.
    pub crop: Option<String>,
    /// Whether black bars are cut away.
    pub letterbox: bool,
    /// What the kept picture shows along x and y, mm; a GelSight Mini's if not given.
    pub field_of_view_mm: Option<[f64; 2]>,
    /// A file of the sensor's light, as `tactile-data calibrate` writes it, of pictures turned and mirrored in the same way.
    pub calibration: Option<String>,
    /// What that file says; the node itself reads no files.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub lamps: Option<CalibratedLamps>,
    /// Whether touches of any holes tell the lamps, until a frame at rest shows another light. It excludes a calibration.
    pub learn_light: bool,
    /// A picture of a touch is at most this old, seconds.
    pub max_age_s: f64,
    /// After so many seconds without a new picture the camera counts as gone, and a new frame at rest is asked for.
    pub reconnect_s: f64,
    /// Whose clock stamps the pictures.
    pub clock: Clock,
    /// Pictures a second that should come; fewer than three quarters of them is reported.
    pub rate_hz: Option<f64>,
    /// Pictures whose median is the frame at rest, 1 to 100.
    pub n_rest: usize,
    /// Each picture is taken by itself and is no part of a film: one is enough for a touch, and nothing shows that a
    /// contact has settled.
    pub stills: bool,
}

impl Default for CameraParameters {
    fn default() -> Self {
        Self {
            channels: Channels::default(),
            quarter_turns: 0,
            mirror: None,
            crop: None,
            letterbox: false,
            field_of_view_mm: None,
            calibration: None,
            lamps: None,
            learn_light: false,
            max_age_s: 0.3,
            reconnect_s: 2.0,
            clock: Clock::default(),
            rate_hz: None,
            n_rest: 9,
            stills: false,
        }
    }
}

/// Whose clock stamps the pictures.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Clock {
    /// One of its own: a picture is as late as its stamp is behind that of the quickest one since the clock was set.
    #[default]
    Own,
    /// The same as this machine's: a picture is as old as its stamp says.
    Shared,
}

/// Where the sensor is mounted, and what standing still means.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ToolParameters {
    /// The sensor's origin (the middle of its picture) in the frame of the tool pose, metres.
    pub sensor_xyz_m: [f64; 3],
    /// Its roll, pitch and yaw there, radians: x to the right in the kept picture, y down, z out of the gel.
    pub sensor_rpy_rad: [f64; 3],
    /// Poses that differ by no more are the same place, mm.
    pub still_mm: f64,
    /// The same for the angle, degrees.
    pub still_deg: f64,
    /// Two touches differ in tilt by at most this, degrees.
    pub max_tilt_deg: f64,
    /// A pose is at most this old, seconds; 20 usual intervals (at least 1 s) if not given.
    pub max_age_s: Option<f64>,
}

impl Default for ToolParameters {
    fn default() -> Self {
        Self {
            sensor_xyz_m: [0.0; 3],
            sensor_rpy_rad: [0.0; 3],
            still_mm: 0.05,
            still_deg: 0.1,
            max_tilt_deg: 5.0,
            max_age_s: None,
        }
    }
}

/// The motions among which the next touch is chosen: a grid of poses, seen from the first touch. What is not given is the
/// bank's.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct ReachParameters {
    /// How far to each side along x and y, mm.
    pub xy_half_mm: Option<f64>,
    /// From one to the next along x and y, mm.
    pub xy_step_mm: Option<f64>,
    /// How far to each side in angle, degrees.
    pub theta_half_deg: Option<f64>,
    /// From one to the next in angle, degrees.
    pub theta_step_deg: Option<f64>,
}

/// What a user chooses of an episode, by name: the numbers of [`Settings`]. The first episode's draws have the seed, each
/// further one has the next number.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(transparent)]
pub struct EpisodeParameters(BTreeMap<String, Value>);

impl EpisodeParameters {
    /// Some settings with these changed.
    ///
    /// # Errors
    /// A name that no setting has, a value of another kind or out of its range.
    pub fn applied_to(&self, mut settings: Settings) -> Result<Settings> {
        for (name, value) in &self.0 {
            let text = match value {
                Value::Null => "none".into(),
                Value::String(text) => text.clone(),
                other => other.to_string(),
            };
            settings.set(name, &text)?;
        }
        Ok(settings)
    }
}

/// Names of frames in what is published.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct FrameParameters {
    /// The sensor's.
    pub sensor: String,
    /// The part's, in which the belief is drawn.
    pub part: String,
}

impl Default for FrameParameters {
    fn default() -> Self {
        Self { sensor: "tactile_sensor".into(), part: "part".into() }
    }
}

impl Parameters {
    /// Reads a parameter file of ROS 2: the settings below `ros__parameters` of every entry that means this node
    /// (`/**`, `node`, `/namespace/node`, or `namespace:` with `node:` below it), later ones over earlier ones.
    ///
    /// # Errors
    /// No YAML, no entry for this node, a name that no parameter has, a value out of range.
    pub fn from_yaml(text: &str, node: &str, place: &str) -> Result<Map<String, Value>> {
        let root: Value = serde_saphyr::from_str(text).map_err(|error| {
            let line = error.to_string().lines().next().unwrap_or_default().to_owned();
            Error::invalid(place, "a parameter file in YAML", line)
        })?;
        let mut found = Map::new();
        let mut is_found = false;
        entries(&root, "", &mut |path, parameters| {
            if is_this_node(path, node) {
                is_found = true;
                merge(&mut found, parameters);
            }
        });
        if !is_found {
            let expected = format!("ros__parameters below /**: or {node}:");
            return Err(Error::invalid(place, expected, "none"));
        }
        Ok(found)
    }

    /// Sets `name` (with dots) to a value as YAML has it, among parameters read before.
    ///
    /// # Errors
    /// Text that is no YAML.
    pub fn set(parameters: &mut Map<String, Value>, name: &str, value: &str) -> Result<()> {
        let value: Value = serde_saphyr::from_str(value)
            .map_err(|_| Error::invalid(format!("parameter {name}"), "a value in YAML", value))?;
        merge(parameters, &Map::from_iter([(name.to_owned(), value)]));
        Ok(())
    }

    /// The parameters of what was read; ROS' own `use_sim_time` and [`DISTRIBUTION`] are left aside.
    ///
    /// # Errors
    /// A name that no parameter has, a value of another type or out of range.
    pub fn of(mut parameters: Map<String, Value>) -> Result<Self> {
        for name in ["use_sim_time", DISTRIBUTION] {
            parameters.remove(name);
        }
        let parameters: Self = serde_json::from_value(Value::Object(parameters))
            .map_err(|error| Error::invalid("parameters", "names and values of this node", error.to_string()))?;
        parameters.validate()?;
        Ok(parameters)
    }

    /// Refuses numbers out of range.
    ///
    /// # Errors
    /// The first of them, by its name.
    pub fn validate(&self) -> Result<()> {
        let Self { camera, tool, .. } = self;
        let positive = [
            ("observe_timeout_s", self.observe_timeout_s),
            ("camera.max_age_s", Some(camera.max_age_s)),
            ("camera.reconnect_s", Some(camera.reconnect_s)),
            ("camera.rate_hz", camera.rate_hz),
            ("tool.still_mm", Some(tool.still_mm)),
            ("tool.still_deg", Some(tool.still_deg)),
            ("tool.max_tilt_deg", Some(tool.max_tilt_deg)),
            ("tool.max_age_s", tool.max_age_s),
        ];
        for (name, value) in positive {
            if let Some(value) = value.filter(|value| !(value.is_finite() && *value > 0.0 && *value < 1e9)) {
                return Err(Error::invalid(name, "a positive number", value.to_string()));
            }
        }
        if !(1..=100).contains(&camera.n_rest) {
            return Err(Error::invalid("camera.n_rest", "1 to 100 pictures", camera.n_rest.to_string()));
        }
        if camera.learn_light && camera.calibration.is_some() {
            return Err(Error::invalid("camera.learn_light", "false where camera.calibration is given", "true"));
        }
        self.episode.applied_to(Settings::default())?;
        self.tool.tool_from_sensor()?;
        camera.geometry().map(|_| ())
    }

    /// What the episode of a number runs with, from 0 on.
    ///
    /// # Errors
    /// As [`EpisodeParameters::applied_to`].
    pub fn episode_config(&self, model: &Model, episode: u64) -> Result<EpisodeConfig> {
        let mut config = EpisodeConfig::of_side(model, self.side);
        config.settings = self.episode.applied_to(config.settings)?;
        config.settings.seed = config.settings.seed.wrapping_add(episode);
        Ok(config)
    }

    /// The poses that can be reached, seen from the first touch.
    ///
    /// # Errors
    /// Numbers that make no grid.
    pub fn reach(&self, bank: &PoseGrid) -> Result<PoseGrid> {
        let asked = &self.reach;
        let grid = PoseGrid {
            xy_half_mm: asked.xy_half_mm.unwrap_or(bank.xy_half_mm),
            xy_step_mm: asked.xy_step_mm.unwrap_or(bank.xy_step_mm),
            theta_half_deg: asked.theta_half_deg.unwrap_or(bank.theta_half_deg),
            theta_step_deg: asked.theta_step_deg.unwrap_or(bank.theta_step_deg),
        };
        grid.validate()?;
        Ok(grid)
    }
}

impl CameraParameters {
    /// The geometry of the pictures.
    ///
    /// # Errors
    /// A crop that cannot be read.
    pub fn geometry(&self) -> Result<Geometry> {
        let crop = self.crop.as_deref().filter(|crop| !crop.is_empty()).map(str::parse::<Crop>).transpose()?;
        Ok(Geometry {
            channels: self.channels,
            quarter_turns: self.quarter_turns,
            mirror: self.mirror,
            crop,
            letterbox: self.letterbox,
            field_of_view_mm: self.field_of_view_mm,
            frame_px: None,
            lamps: self.lamps.clone(),
        })
    }
}

impl ToolParameters {
    /// The sensor in the tool's frame.
    ///
    /// # Errors
    /// Numbers that are not finite, or more than 10 m.
    pub fn tool_from_sensor(&self) -> Result<Rigid> {
        Ok(Rigid::from_xyz_rpy(self.sensor_xyz_m, self.sensor_rpy_rad, "tool.sensor_xyz_m, tool.sensor_rpy_rad")?)
    }
}

/// Calls `found` with the path and the parameters of each entry of a file, in its order.
fn entries(value: &Value, path: &str, found: &mut dyn FnMut(&str, &Map<String, Value>)) {
    let Value::Object(map) = value else { return };
    for (key, value) in map {
        match value {
            Value::Object(parameters) if key == "ros__parameters" => found(path, parameters),
            _ => entries(value, &format!("{path}/{}", key.trim_matches('/')), found),
        }
    }
}

/// Whether an entry of a file means a node by its full name.
fn is_this_node(path: &str, node: &str) -> bool {
    let last = node.rsplit('/').next().unwrap_or(node);
    path == "/**" || path == node || path == format!("/{last}") || path == format!("/**/{last}")
}

/// Sets what `new` says; `a.b` is `b` in `a`.
fn merge(into: &mut Map<String, Value>, new: &Map<String, Value>) {
    for (name, value) in new {
        let (first, rest) = name.split_once('.').map_or((name.as_str(), None), |(first, rest)| (first, Some(rest)));
        let nested = match (rest, value) {
            (Some(rest), _) => Some(Map::from_iter([(rest.to_owned(), value.clone())])),
            (None, Value::Object(map)) => Some(map.clone()),
            (None, _) => None,
        };
        match nested {
            Some(nested) => {
                let below = into.entry(first).or_insert_with(|| Value::Object(Map::new()));
                if !below.is_object() {
                    *below = Value::Object(Map::new());
                }
                if let Value::Object(below) = below {
                    merge(below, &nested);
                }
            }
            None => {
                into.insert(first.to_owned(), value.clone());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const FILE: &str = "
/**:
  ros__parameters:
    use_sim_time: false
    ros_distro: humble
    camera:
      crop: border:1/7
      max_age_s: 0.5
/left/tactile_filter:
  ros__parameters:
    trigger: contact
    camera.mirror: x
    camera.field_of_view_mm: [18.6, 14.3]
right:
  tactile_filter:
    ros__parameters:
      episode.seed: 7
";

    #[test]
    fn a_file_of_ros_names_nodes_in_all_its_ways() {
        let of = |node| Parameters::of(Parameters::from_yaml(FILE, node, "file.yaml").unwrap()).unwrap();
        let left = of("/left/tactile_filter");
        assert_eq!(left.trigger, Trigger::Contact);
        assert_eq!(left.camera.crop.as_deref(), Some("border:1/7"));
        assert_eq!((left.camera.max_age_s, left.camera.mirror), (0.5, Some(Mirror::X)));
        assert_eq!(left.camera.field_of_view_mm, Some([18.6, 14.3]));
        let right = of("/right/tactile_filter");
        let settings = right.episode.applied_to(Settings::default()).unwrap();
        assert_eq!((right.trigger, settings), (Trigger::Service, Settings { seed: 7, ..Settings::default() }));
        let only = "/other:\n  ros__parameters:\n    trigger: contact\n";
        let none = Parameters::from_yaml(only, "/tactile_filter", "file.yaml").unwrap_err().to_string();
        assert_eq!(none, "file.yaml: expected ros__parameters below /**: or /tactile_filter:, got none");
        let broken = Parameters::from_yaml("a: [1", "/n", "file.yaml").unwrap_err().to_string();
        assert!(
            broken.starts_with("file.yaml: expected a parameter file in YAML") && !broken.contains('\n'),
            "{broken}"
        );
    }

    #[test]
    fn words_on_the_command_line_come_last_and_typing_errors_are_named() {
        let mut read = Parameters::from_yaml(FILE, "/tactile_filter", "file.yaml").unwrap();
        Parameters::set(&mut read, "camera.max_age_s", "0.1").unwrap();
        Parameters::set(&mut read, "reach.xy_half_mm", "6").unwrap();
        Parameters::set(&mut read, "episode.stop_place_mm", "2").unwrap();
        Parameters::set(&mut read, "episode.false_accept", "none").unwrap();
        let parameters = Parameters::of(read.clone()).unwrap();
        assert_eq!((parameters.camera.max_age_s, parameters.reach.xy_half_mm), (0.1, Some(6.0)));
        let settings = parameters.episode.applied_to(Settings::default()).unwrap();
        assert_eq!(settings, Settings { stop_place_mm: Some(2.0), false_accept: None, ..Settings::default() });
        for (name, value, said) in [
            ("camera.crob", "border:1/7", "`crob`"),
            ("camera.crop", "half", "crop: expected LEFT,TOP,WIDTH,HEIGHT"),
            ("camera.max_age_s", "-1", "camera.max_age_s: expected a positive number, got -1"),
            ("tool.still_mm", ".nan", "tool.still_mm"),
            ("camera.n_rest", "0", "1 to 100"),
            ("episode.max_touches", "0", "episode.max_touches: expected 1 to 1000, got 0"),
            ("episode.max_touches", "many", "episode.max_touches: expected a whole number, not negative, got many"),
            ("episode.temperature", "0.1", "episode.temperature: expected one of stop_probability"),
            ("trigger", "always", "`service` or `contact`"),
            ("side", "pin", "`hole` or `peg`"),
        ] {
            let mut wrong = read.clone();
            let error = Parameters::set(&mut wrong, name, value).and_then(|()| Parameters::of(wrong)).unwrap_err();
            assert!(error.to_string().contains(said), "{error}");
        }
    }

    #[test]
    fn the_reach_is_the_banks_unless_said_otherwise() {
        let mut parameters = Parameters::default();
        assert_eq!(parameters.reach(&PoseGrid::SMALL).unwrap(), PoseGrid::SMALL);
        parameters.reach.xy_half_mm = Some(2.0 * PoseGrid::SMALL.xy_step_mm);
        let reach = parameters.reach(&PoseGrid::SMALL).unwrap();
        assert_eq!((reach.n_xy(), reach.n_theta()), (5, PoseGrid::SMALL.n_theta()));
        parameters.reach.xy_step_mm = Some(0.0);
        assert!(parameters.reach(&PoseGrid::SMALL).is_err());
    }
}
