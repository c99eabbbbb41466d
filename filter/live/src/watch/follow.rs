//! A view that follows what a node publishes: from the node itself, the network or a log, which all have the same bytes.

use tactile_data::pose::se2::Se2;
use tactile_data::recording::ros::messages::{DiagnosticArray, Level as Status, OccupancyGrid, Text, from_cdr};
use tactile_filter::StopReason;

use super::view::{Camera, Level, Message, Part, Place, PlaceMap, Pressed, View};
use crate::decision::DecisionReport;
use crate::event::Topic;

/// Messages that are kept for a person.
const MAX_MESSAGES: usize = 200;

/// What is shown of the messages so far.
#[derive(Clone, Debug, Default)]
pub struct Follower {
    view: View,
    start_ns: Option<i64>,
    map: Option<PlaceMap>,
    felt: Vec<i8>,
}

impl Follower {
    /// Takes in a message of a topic, in CDR; one that cannot be read changes nothing but the time.
    pub fn take(&mut self, time_ns: i64, topic: Topic, cdr: &[u8]) {
        let start_ns = *self.start_ns.get_or_insert(time_ns);
        self.view.time_s = (time_ns - start_ns) as f64 * 1e-9;
        let text = || from_cdr::<Text>(cdr, "message").ok().map(|text| text.data);
        match topic {
            Topic::Decision => {
                if let Some(report) = text().and_then(|json| serde_json::from_str::<DecisionReport>(&json).ok()) {
                    self.decided(&report);
                }
            }
            Topic::Events => {
                if let Some(line) = text() {
                    self.said(line);
                }
            }
            Topic::Belief => {
                if let Ok(grid) = from_cdr::<OccupancyGrid>(cdr, "belief") {
                    self.map = map(&grid);
                    self.place_map();
                }
            }
            Topic::Felt => {
                if let Ok(grid) = from_cdr::<OccupancyGrid>(cdr, "felt") {
                    self.felt = grid.data;
                }
            }
            Topic::Diagnostics => {
                if let Ok(diagnostics) = from_cdr::<DiagnosticArray>(cdr, "diagnostics") {
                    self.diagnosed(&diagnostics);
                }
            }
            _ => {}
        }
    }

    /// What is shown now.
    pub fn view(&self) -> &View {
        &self.view
    }

    /// What was felt so far, as the node tells it ([`tactile_infer::maps::picture::felt`]); empty where it draws no maps.
    pub fn felt(&self) -> &[i8] {
        &self.felt
    }

    fn decided(&mut self, report: &DecisionReport) {
        let view = &mut self.view;
        if report.touch <= 1 {
            view.touches.clear();
        }
        let moved = report.moved.unwrap_or(Se2::IDENTITY);
        view.touches.push(Pressed { moved, edge_share: Some(report.edge_share), refused: None });
        let part =
            |(name, probability): &(String, f64)| Part { name: name.clone(), probability: *probability, map: None };
        view.parts = report.posterior.iter().map(part).collect();
        view.sort();
        let estimate = &report.estimate;
        let [[xx, ..], [_, yy, _], [.., tt]] = estimate.covariance;
        view.place = Some(Place {
            part: estimate.part.clone(),
            probability: estimate.probability,
            other: report.other().map(|other| other.part.clone()),
            part_from_sensor: estimate.part_from_sensor,
            sd_mm: [xx.max(0.0).sqrt(), yy.max(0.0).sqrt()],
            sd_deg: tt.max(0.0).sqrt().to_degrees(),
        });
        view.sensor_from_next = report.next;
        view.entropy_nats = Some(estimate.entropy_nats);
        view.stop = report.stop.map(|reason| words(reason).to_owned());
        view.status = format!("episode {}, {}", report.episode, report.line());
        self.map = None;
        self.felt.clear();
    }

    fn said(&mut self, text: String) {
        let refusal = text.strip_prefix("no touch was observed: ");
        if let Some(reason) = refusal {
            let refused = Some(reason.to_owned());
            self.view.touches.push(Pressed { moved: Se2::IDENTITY, edge_share: None, refused });
        }
        let level = if text.starts_with("at rest") { Level::Info } else { Level::Warning };
        let messages = &mut self.view.messages;
        messages.push(Message { time_s: self.view.time_s, level, text });
        let n_old = messages.len().saturating_sub(MAX_MESSAGES);
        messages.drain(..n_old);
    }

    fn diagnosed(&mut self, diagnostics: &DiagnosticArray) {
        let Some(camera) = diagnostics.status.iter().find(|status| status.name.ends_with("camera")) else { return };
        let number = |key: &str| camera.values.iter().find(|value| value.key == key)?.value.parse().ok();
        let is_good = camera.level == Status::Ok;
        self.view.camera = Camera { frames_per_s: number("rate_hz"), age_s: number("age_s"), is_good };
        if self.view.place.is_none() {
            let rest = diagnostics.status.iter().find(|status| status.name.ends_with("at rest"));
            let message = rest.filter(|rest| rest.level != Status::Ok).map(|rest| rest.message.clone());
            self.view.status = message.unwrap_or_else(|| "waiting for the first touch".to_owned());
        }
    }

    /// Gives the likeliest part its map.
    fn place_map(&mut self) {
        let Some(place) = &self.view.place else { return };
        if let Some(part) = self.view.parts.iter_mut().find(|part| part.name == place.part) {
            let probability = part.probability;
            part.map = self.map.clone().map(|mut map| {
                map.values.iter_mut().for_each(|value| *value *= probability);
                map
            });
        }
    }
}

fn words(reason: StopReason) -> &'static str {
    match reason {
        StopReason::Confident => "confident",
        StopReason::NoneOfThese => "none of these parts",
        StopReason::TouchLimit => "no more touches",
        StopReason::NothingToLearn => "nothing left to touch",
    }
}

/// A grid's cells as shares that sum to one; `None` of a grid that is not square, or empty.
fn map(grid: &OccupancyGrid) -> Option<PlaceMap> {
    let n_xy = grid.width as usize;
    if n_xy == 0 || grid.height != grid.width || grid.data.len() != n_xy.checked_mul(n_xy)? {
        return None;
    }
    let sum: f64 = grid.data.iter().map(|value| f64::from((*value).max(0))).sum();
    // A message has rows of equal y, a map columns of equal x.
    let cell = |i: usize| f64::from(grid.data[(i % n_xy) * n_xy + i / n_xy].max(0)) / sum.max(1.0);
    // A message has the step with 32 bits: to a thousandth of a mm it is the grid's.
    let half_mm = ((n_xy - 1) as f64 * f64::from(grid.resolution) * 1e6 / 2.0).round() / 1e3;
    Some(PlaceMap { n_xy, half_mm, values: (0..n_xy * n_xy).map(cell).collect() })
}

#[cfg(test)]
mod tests {
    use super::*;
    use tactile_data::recording::ros::messages::{DiagnosticStatus, Header, KeyValue, Pose, Time, to_cdr};

    fn text(data: &str) -> Vec<u8> {
        to_cdr(&Text { data: data.into() })
    }

    fn decision(touch: usize, stop: &str) -> Vec<u8> {
        text(&json(touch, stop))
    }

    fn json(touch: usize, stop: &str) -> String {
        format!(
            r#"{{"episode":2,"touch":{touch},"moved":null,"edge_share":0.25,"next":null,"stop":{stop},
            "estimate":{{"part":"B","probability":0.75,"part_from_sensor":{{"x_mm":1.0,"y_mm":2.0,"theta_rad":0.0}},
            "covariance":[[4.0,0.0,0.0],[0.0,9.0,0.0],[0.0,0.0,0.0]],"fit":null,"entropy_nats":1.5,"warnings":[]}},
            "posterior":[["A",0.25],["B",0.75]]}}"#
        )
    }

    #[test]
    fn a_view_is_what_was_published() {
        let mut follower = Follower::default();
        follower.take(1_000_000_000, Topic::Events, &text("at rest: 4x4 pixels"));
        follower.take(3_500_000_000, Topic::Decision, &decision(1, "null"));
        let belief = OccupancyGrid {
            header: Header::default(),
            map_load_time: Time::default(),
            resolution: 0.002,
            width: 2,
            height: 2,
            origin: Pose { position: [0.0; 3], orientation: [0.0, 0.0, 0.0, 1.0] },
            // All of it at the larger x and the smaller y.
            data: vec![0, 100, 0, 0],
        };
        follower.take(3_500_000_000, Topic::Belief, &to_cdr(&belief));
        follower.take(3_500_000_000, Topic::Felt, &to_cdr(&belief));
        assert_eq!(follower.felt(), [0, 100, 0, 0]);
        let view = follower.view();
        assert_eq!(
            (view.time_s, view.parts[0].name.as_str(), view.place.as_ref().unwrap().sd_mm),
            (2.5, "B", [2.0, 3.0])
        );
        let map = view.parts[0].map.as_ref().unwrap();
        assert_eq!((map.half_mm, map.at(1.0, -1.0), map.at(1.0, 1.0)), (1.0, 0.75, 0.0));
        assert_eq!((view.messages[0].level, view.touches.len(), view.stop.as_deref()), (Level::Info, 1, None));

        follower.take(4_000_000_000, Topic::Events, &text("no touch was observed: dark"));
        follower.take(5_000_000_000, Topic::Decision, &decision(2, "\"confident\""));
        let view = follower.view();
        assert_eq!((view.touches.len(), view.touches[1].refused.as_deref()), (3, Some("dark")));
        assert!(view.stop.as_deref() == Some("confident") && follower.felt().is_empty());
        // Another hole.
        follower.take(6_000_000_000, Topic::Decision, &decision(1, "null"));
        assert_eq!((follower.view().touches.len(), follower.view().stop.as_deref()), (1, None));
        assert_eq!(follower.view().place.as_ref().unwrap().other, None);
        let other = r#""runner_up":{"part":"A","probability":0.25},"fit""#;
        let limit = json(2, "\"touch-limit\"").replace("\"fit\"", other);
        follower.take(7_000_000_000, Topic::Decision, &text(&limit));
        assert_eq!(follower.view().place.as_ref().unwrap().other.as_deref(), Some("A"));
        assert_eq!(follower.view().status, "episode 2, touch 2: no more touches; B, 75.0 %, or A, 25.0 %");
    }

    #[test]
    fn what_cannot_be_read_is_left_out() {
        let mut follower = Follower::default();
        for topic in Topic::ALL {
            follower.take(1, topic, &[0, 1, 0, 0, 255, 255, 255, 255]);
            follower.take(1, topic, &[]);
        }
        assert_eq!(*follower.view(), View::default());
        let values = vec![KeyValue::new("rate_hz", "25.0"), KeyValue::new("age_s", "none")];
        let camera = DiagnosticStatus { name: "tactile_filter: camera".into(), values, ..DiagnosticStatus::default() };
        follower.take(
            2,
            Topic::Diagnostics,
            &to_cdr(&DiagnosticArray { header: Header::default(), status: vec![camera] }),
        );
        let shown = follower.view().camera;
        assert_eq!((shown.frames_per_s, shown.age_s, shown.is_good), (Some(25.0), None, true));
    }
}
