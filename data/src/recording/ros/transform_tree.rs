//! Transforms between frames (`tf2`), and the chain of them from one frame to another.

use std::collections::{BTreeMap, VecDeque};

use crate::error::{Error, Result};
use crate::recording::ros::rigid::Rigid;
use crate::text::suggest::with_closest;

/// One frame in another, over time.
#[derive(Clone, Debug, Default)]
struct Link {
    /// The newest that holds for all time.
    fixed: Option<Rigid>,
    /// `parent_from_child` by time, nanoseconds.
    moving: Vec<(i64, Rigid)>,
}

/// All transforms of a recording, by the names of parent and child.
#[derive(Clone, Debug, Default)]
pub struct TransformTree {
    links: BTreeMap<[String; 2], Link>,
}

/// The links from one frame to another, the first from the base.
#[derive(Clone, Debug)]
pub struct Chain {
    /// Each with whether it goes from parent to child.
    links: Vec<(Link, bool)>,
}

impl TransformTree {
    /// Adds `parent_from_child` at a time in nanoseconds, or for all time.
    pub fn insert(&mut self, [parent, child]: [&str; 2], time_ns: Option<i64>, pose: Rigid) {
        let names = [parent, child].map(|name| name.trim_start_matches('/').to_owned());
        let link = self.links.entry(names).or_default();
        match time_ns {
            None => link.fixed = Some(pose),
            Some(time_ns) => link.moving.push((time_ns, pose)),
        }
    }

    /// The chain of transforms that gives `base_from_sensor`.
    ///
    /// # Errors
    /// A frame that is not there, with the frames that are; frames that nothing connects.
    pub fn chain(&self, [base, sensor]: [&str; 2]) -> Result<Chain> {
        let mut frames: Vec<&str> = self.links.keys().flatten().map(String::as_str).collect();
        frames.sort_unstable();
        frames.dedup();
        if let Some(unknown) = [base, sensor].into_iter().find(|name| !frames.contains(name)) {
            let all = if frames.is_empty() { "transforms in the bag".to_owned() } else { frames.join(", ") };
            return Err(Error::invalid("--frames", all, with_closest(unknown, frames)));
        }
        // Breadth first from the base; each frame keeps the link over which it was reached.
        let mut reached: BTreeMap<&str, Option<(&str, &[String; 2])>> = BTreeMap::from([(base, None)]);
        let mut waiting = VecDeque::from([base]);
        while let Some(frame) = waiting.pop_front() {
            for names in self.links.keys() {
                let [parent, child] = names.each_ref().map(String::as_str);
                let next = if parent == frame { child } else { parent };
                if (parent == frame || child == frame) && !reached.contains_key(next) {
                    reached.insert(next, Some((frame, names)));
                    waiting.push_back(next);
                }
            }
        }
        if !reached.contains_key(sensor) {
            let expected = format!("transforms that connect {base} with {sensor}");
            return Err(Error::invalid("--frames", expected, "two trees that nothing connects"));
        }
        let mut links = Vec::new();
        let mut frame = sensor;
        while let Some(Some((before, names))) = reached.get(frame) {
            let mut link = self.links[*names].clone();
            link.moving.sort_by_key(|(time_ns, _)| *time_ns);
            links.push((link, names[0] == *before));
            frame = before;
        }
        links.reverse();
        Ok(Chain { links })
    }
}

impl Chain {
    /// `base_from_sensor` at a time, each link by its newest transform before, and the age of the oldest of these,
    /// nanoseconds. `None` where one of them is not known yet.
    pub fn at(&self, time_ns: i64) -> Option<(Rigid, i64)> {
        let (mut base_from_sensor, mut age_ns): (Option<Rigid>, i64) = (None, 0);
        for (link, is_forward) in &self.links {
            let n_before = link.moving.partition_point(|(time, _)| *time <= time_ns);
            let parent_from_child = match (n_before.checked_sub(1).map(|last| link.moving[last]), link.fixed) {
                (Some((time, pose)), _) => {
                    age_ns = age_ns.max(time_ns.saturating_sub(time));
                    pose
                }
                (None, Some(pose)) => pose,
                (None, None) => return None,
            };
            let step = if *is_forward { parent_from_child } else { parent_from_child.inverse() };
            base_from_sensor = Some(base_from_sensor.map_or(step, |so_far| so_far * step));
        }
        // The base itself, where it is the sensor too.
        Some((base_from_sensor.unwrap_or(Rigid::IDENTITY), age_ns))
    }

    /// The times at which a link moved, nanoseconds, each once.
    pub fn times_ns(&self) -> Vec<i64> {
        let mut times: Vec<i64> =
            self.links.iter().flat_map(|(link, _)| link.moving.iter().map(|(time, _)| *time)).collect();
        times.sort_unstable();
        times.dedup();
        times
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pose::se2::Se2;

    fn at(x_mm: f64, y_mm: f64, theta_deg: f64) -> Se2 {
        Se2::from_degrees(x_mm, y_mm, theta_deg)
    }

    fn tree() -> TransformTree {
        let mut tree = TransformTree::default();
        let mut add = |names, time, pose: Se2| tree.insert(names, time, Rigid::from_plane(&pose));
        add(["base", "tool"], Some(20), at(20.0, 0.0, 90.0));
        add(["base", "tool"], Some(10), at(10.0, 0.0, 0.0));
        add(["/tool", "sensor"], None, at(0.0, 5.0, 0.0));
        add(["base", "board"], None, at(1.0, 2.0, 30.0));
        add(["odd", "one"], None, at(0.0, 0.0, 0.0));
        tree
    }

    #[test]
    fn a_chain_goes_up_and_down_and_takes_the_newest_before() {
        let tree = tree();
        let base = tree.chain(["base", "sensor"]).unwrap();
        assert!(base.at(9).is_none());
        for (time, tool, age) in
            [(10, at(10.0, 0.0, 0.0), 0), (19, at(10.0, 0.0, 0.0), 9), (25, at(20.0, 0.0, 90.0), 5)]
        {
            let (pose, found_age) = base.at(time).unwrap();
            let expected = tool * at(0.0, 5.0, 0.0);
            assert!(pose.project().pose.distance_mm(&expected) < 1e-9 && found_age == age, "{time}");
            let (pose, _) = tree.chain(["board", "sensor"]).unwrap().at(time).unwrap();
            assert!(pose.project().pose.distance_mm(&(at(1.0, 2.0, 30.0).inverse() * expected)) < 1e-9);
        }
        assert_eq!(base.times_ns(), [10, 20]);
    }

    #[test]
    fn frames_that_are_not_there_or_not_connected_are_named() {
        let message = |frames| tree().chain(frames).unwrap_err().to_string();
        assert!(message(["base", "sensr"]).contains("did you mean sensor?"));
        assert!(message(["base", "one"]).contains("connect base with one"));
        let none = TransformTree::default().chain(["base", "tool"]).unwrap_err().to_string();
        assert!(none.contains("transforms in the bag"), "{none}");
    }
}
