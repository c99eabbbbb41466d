//! How the node is, as it says it once a second.

use tactile_data::recording::ros::messages::{DiagnosticArray, DiagnosticStatus, Header, KeyValue, Level, Time};

use super::Node;

impl Node {
    /// The message.
    pub(super) fn diagnostics(&self) -> DiagnosticArray {
        let header = Header { stamp: Time::of_nanoseconds(self.now_ns), frame_id: String::new() };
        DiagnosticArray { header, status: vec![self.of_camera(), self.of_tool(), self.of_rest(), self.of_episode()] }
    }

    fn of_camera(&self) -> DiagnosticStatus {
        let worst = self.troubles.active().max_by_key(|(level, _)| *level);
        let (level, message) = worst.unwrap_or((Level::Ok, FINE));
        let counts = self.camera.counts();
        let values = vec![
            KeyValue::new("pictures", counts.new),
            KeyValue::new("repeated", counts.repeated),
            KeyValue::new("malformed", counts.malformed),
            KeyValue::new("rate_hz", number(self.camera.rate_hz())),
            KeyValue::new("age_s", number(self.camera.age_s(self.now_ns))),
        ];
        status("camera", level, message, values)
    }

    fn of_tool(&self) -> DiagnosticStatus {
        let [n_poses, n_malformed] = self.tool.counts();
        let values = vec![
            KeyValue::new("poses", n_poses),
            KeyValue::new("malformed", n_malformed),
            KeyValue::new("age_s", number(self.tool.age_s(self.now_ns))),
        ];
        match self.tool.placed(self.now_ns) {
            Ok(_) => status("tool", Level::Ok, FINE, values),
            Err(error) => status("tool", Level::Stale, error.to_string(), values),
        }
    }

    fn of_rest(&self) -> DiagnosticStatus {
        let level = if self.rest_needed.is_some() { Level::Warn } else { Level::Ok };
        status("frame at rest", level, self.rest_needed.as_deref().unwrap_or(FINE), Vec::new())
    }

    fn of_episode(&self) -> DiagnosticStatus {
        let n_touches = self.n_touches();
        let values = vec![
            KeyValue::new("episode", self.n_episodes),
            KeyValue::new("touches", n_touches),
            KeyValue::new("refused", self.n_refused),
            KeyValue::new("entropy", number(self.latest.map(|latest| latest[0]))),
            KeyValue::new("probability", number(self.latest.map(|latest| latest[1]))),
        ];
        status("episode", Level::Ok, format!("{n_touches} touches"), values)
    }
}

/// What is said where nothing is wrong.
const FINE: &str = "fine";

fn status(name: &str, level: Level, message: impl Into<String>, values: Vec<KeyValue>) -> DiagnosticStatus {
    let name = format!("tactile_filter: {name}");
    DiagnosticStatus { level, name, message: message.into(), hardware_id: String::new(), values }
}

fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "none".to_owned(), |value| format!("{value:.3}"))
}
