//! What is wrong now, each thing reported once.

use std::collections::BTreeMap;

use tactile_data::recording::ros::messages::Level;

/// The same trouble is reported again no sooner than this, nanoseconds.
const AGAIN_NS: i64 = 10_000_000_000;

/// Kinds of trouble.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Trouble {
    /// No pictures come.
    NoPictures,
    /// Too few pictures come.
    Rate,
    /// The camera sends one picture again and again.
    Frozen,
    /// Messages that hold no picture.
    MalformedPicture,
    /// A picture's encoding leaves something open.
    Encoding,
    /// The clock that stamps the pictures.
    Clock,
    /// Messages that hold no pose.
    MalformedPose,
    /// Messages that say where a part is and cannot be used.
    PartPose,
    /// A contact without a pose.
    NoPose,
    /// Hole after hole is none of the parts.
    Refused,
}

/// What is wrong now, and since when it was last reported.
#[derive(Clone, Debug, Default)]
pub struct Troubles {
    known: BTreeMap<Trouble, Known>,
}

#[derive(Clone, Debug)]
struct Known {
    is_active: bool,
    /// Whether it was reported since it began.
    is_said: bool,
    reported_ns: i64,
    level: Level,
    text: String,
}

impl Troubles {
    /// Something is wrong; the line to report, where it was not reported yet.
    pub fn raise(&mut self, now_ns: i64, trouble: Trouble, level: Level, text: String) -> Option<String> {
        let known = self.known.get(&trouble);
        let is_new = known.is_none_or(|known| !known.is_said && now_ns - known.reported_ns >= AGAIN_NS);
        let reported_ns = if is_new { now_ns } else { known.map_or(now_ns, |known| known.reported_ns) };
        let is_said = is_new || known.is_some_and(|known| known.is_said);
        let said = is_new.then(|| text.clone());
        self.known.insert(trouble, Known { is_active: true, is_said, reported_ns, level, text });
        said
    }

    /// It is over; whether it had been wrong.
    pub fn clear(&mut self, trouble: Trouble) -> bool {
        let Some(known) = self.known.get_mut(&trouble) else { return false };
        known.is_said = false;
        std::mem::replace(&mut known.is_active, false)
    }

    /// What is wrong now.
    pub fn active(&self) -> impl Iterator<Item = (Level, &str)> {
        self.known.values().filter(|known| known.is_active).map(|known| (known.level, known.text.as_str()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_is_reported_once_while_it_lasts() {
        let mut troubles = Troubles::default();
        let raise = |troubles: &mut Troubles, s: i64| {
            troubles.raise(s * 1_000_000_000, Trouble::Frozen, Level::Error, format!("at {s}"))
        };
        assert_eq!(raise(&mut troubles, 0).as_deref(), Some("at 0"));
        assert_eq!(raise(&mut troubles, 60), None);
        assert!(troubles.clear(Trouble::Frozen) && !troubles.clear(Trouble::Frozen));
        assert_eq!(troubles.active().count(), 0);
        // It comes and goes: not each time.
        assert_eq!(raise(&mut troubles, 5), None);
        assert_eq!(troubles.active().collect::<Vec<_>>(), [(Level::Error, "at 5")]);
        troubles.clear(Trouble::Frozen);
        assert_eq!(raise(&mut troubles, 11).as_deref(), Some("at 11"));
        // It comes back at once and stays: that is said when it may be said again.
        troubles.clear(Trouble::Frozen);
        let said: Vec<_> = (12..60).filter_map(|s| raise(&mut troubles, s)).collect();
        assert_eq!(said, ["at 21"]);
    }
}
