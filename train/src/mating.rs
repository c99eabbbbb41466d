//! Which hole and which peg of a dataset were touched at one place.

use std::collections::{BTreeMap, HashMap, HashSet};

use tactile_data::dataset::store::Dataset;
use tactile_data::dataset::touch::{Side, Touch};
use tactile_data::pose::se2::{Se2, wrap_angle};

/// The frames of one mating pair in a dataset.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Pair {
    /// Index of the hole's frame.
    pub hole: usize,
    /// Index of the peg's frame.
    pub peg: usize,
    /// Where the hole was touched, seen from where the peg was: by this the peg's view is moved. `None` where both were
    /// touched at one pose, or where that is not known.
    pub sensor_from_hole: Option<Se2>,
}

/// How far apart a hole and its peg may have been touched.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Within {
    /// Distance, mm.
    pub mm: f64,
    /// Turn, degrees.
    pub deg: f64,
}

/// Poses nearer than this are one: moving a view by less changes nothing that can be felt, mm and degrees.
const SAME: (f64, f64) = (0.02, 0.05);

/// One in so many boards, or so large a region of each, is held out where the dataset names none.
const HELD_OUT: usize = 12;

/// Boards from which whole ones are held out; of fewer, a region of each is.
const MANY_BOARDS: usize = 12;

/// None of fewer pairs is held out: three or four would say nothing.
const MIN_PAIRS: usize = 48;

/// The pairs of a dataset: pairs to train on, and pairs that say how good the model is.
#[derive(Clone, Debug, Default)]
pub struct Mating {
    /// Pairs to train on, in the order of their frames.
    pub training: Vec<Pair>,
    /// Held-out pairs, board by board.
    pub held_out: Vec<Vec<Pair>>,
    /// How pairs were found, and what did not mate and why; a line each. Empty where every frame mates with its
    /// neighbour, as in simulated datasets.
    pub notes: Vec<String>,
}

/// Finds the pairs of a dataset.
///
/// A hole and a peg mate that share the name of their pair, or that are neighbours in the dataset at one pose. Of the
/// others a hole and a peg of one part mate whose poses are nearest to each other, both ways, within a tolerance. Where
/// the dataset names no boards to hold out, one in twelve is, or of fewer than twelve boards a region: the twelfth of
/// the pairs that is furthest along x. Pairs nearer to it than half a view are not trained on.
pub fn find(dataset: &Dataset, within: Within) -> Mating {
    let mut finder = Finder { dataset, within, pairs: Vec::new(), mated: HashSet::new(), notes: Vec::new() };
    finder.by_name();
    finder.by_neighbour();
    finder.by_pose();
    finder.pairs.sort_by_key(|pair| pair.hole.max(pair.peg));
    finder.report();
    let Finder { pairs, mut notes, .. } = finder;
    let named = !dataset.meta().held_out.is_empty() || dataset.meta().scene.is_some();
    let (training, held_out) = if named { split_by_name(dataset, pairs) } else { split(dataset, pairs, &mut notes) };
    Mating { training, held_out, notes }
}

struct Finder<'a> {
    dataset: &'a Dataset,
    within: Within,
    pairs: Vec<Pair>,
    mated: HashSet<usize>,
    notes: Vec<String>,
}

impl Finder<'_> {
    fn add(&mut self, hole: usize, peg: usize) {
        let pose = |frame: usize| self.dataset.touch(frame).part_from_sensor;
        let between = pose(peg).zip(pose(hole)).map(|(peg, hole)| peg.inverse() * hole);
        let is_near = |mm: f64, deg: f64| {
            let near = |by: &Se2| by.x_mm.hypot(by.y_mm) <= mm && by.theta_deg().abs() <= deg;
            between.filter(near)
        };
        let is_same = is_near(SAME.0, SAME.1).is_some();
        // What is further apart than the tolerance was said to mate all the same: its poses are not believed.
        let sensor_from_hole = is_near(self.within.mm, self.within.deg).filter(|_| !is_same);
        self.pairs.push(Pair { hole, peg, sensor_from_hole });
        self.mated.extend([hole, peg]);
    }

    /// Frames that share the name of a pair.
    fn by_name(&mut self) {
        let mut named: BTreeMap<&str, Vec<usize>> = BTreeMap::new();
        for (frame, touch) in self.dataset.touches().iter().enumerate() {
            if let Some(name) = &touch.pair {
                named.entry(name).or_default().push(frame);
            }
        }
        let n_named = named.len();
        for frames in named.into_values() {
            let of_side = |side| frames.iter().copied().find(|frame| self.dataset.touch(*frame).side == Some(side));
            if let (Some(hole), Some(peg), 2) = (of_side(Side::Hole), of_side(Side::Peg), frames.len()) {
                self.add(hole, peg);
            }
        }
        if n_named > 0 {
            let n_mated = self.pairs.len();
            self.notes.push(format!("{n_mated} of {n_named} named pairs have one hole and one peg"));
        }
    }

    /// Frames next to each other at one pose.
    fn by_neighbour(&mut self) {
        for second in 1..self.dataset.len() {
            let first = second - 1;
            if self.mated.contains(&first) || self.mated.contains(&second) {
                continue;
            }
            let (a, b) = (self.dataset.touch(first), self.dataset.touch(second));
            let is_one = a.part.is_some() && a.part == b.part && a.part_from_sensor == b.part_from_sensor;
            match (a.side, b.side) {
                (Some(Side::Hole), Some(Side::Peg)) if is_one => self.add(first, second),
                (Some(Side::Peg), Some(Side::Hole)) if is_one => self.add(second, first),
                _ => {}
            }
        }
    }

    /// Frames of one part whose poses are nearest to each other.
    fn by_pose(&mut self) {
        let free = |side| {
            let mut of_part: HashMap<&str, Vec<(usize, Se2)>> = HashMap::new();
            for (frame, touch) in self.dataset.touches().iter().enumerate() {
                let Touch { part: Some(part), part_from_sensor: Some(pose), .. } = touch else { continue };
                if touch.side == Some(side) && !self.mated.contains(&frame) {
                    of_part.entry(part).or_default().push((frame, *pose));
                }
            }
            of_part
        };
        let (holes, pegs) = (free(Side::Hole), free(Side::Peg));
        let mut found = Vec::new();
        for (part, holes) in &holes {
            let Some(pegs) = pegs.get(part) else { continue };
            let nearest = |pose: &Se2, of: &[(usize, Se2)]| {
                let off = |(frame, at): &(usize, Se2)| Some((self.within.off(pose, at)?, *frame));
                of.iter().filter_map(off).min_by(|a, b| a.0.total_cmp(&b.0)).map(|(_, frame)| frame)
            };
            for (hole, pose) in holes {
                let Some(peg) = nearest(pose, pegs) else { continue };
                let back = pegs.iter().find(|(frame, _)| *frame == peg).and_then(|(_, at)| nearest(at, holes));
                if back == Some(*hole) {
                    found.push((*hole, peg));
                }
            }
        }
        if !found.is_empty() {
            let Within { mm, deg } = self.within;
            self.notes.push(format!(
                "{} holes mate with the peg nearest to them, within {mm} mm and {deg} degrees",
                found.len()
            ));
        }
        found.into_iter().for_each(|(hole, peg)| self.add(hole, peg));
    }

    /// What did not mate, and why.
    fn report(&mut self) {
        let (mut alone, mut far, mut unknown) = (0, 0, 0);
        let touches = self.dataset.touches();
        let has =
            |part: &str, side: Side| touches.iter().any(|t| t.side == Some(side) && t.part.as_deref() == Some(part));
        let mut has_mate: HashMap<(&str, Side), bool> = HashMap::new();
        for (frame, touch) in touches.iter().enumerate() {
            let Some(side) = touch.side else { continue };
            if self.mated.contains(&frame) {
                continue;
            }
            let other = if side == Side::Hole { Side::Peg } else { Side::Hole };
            match (&touch.part, touch.part_from_sensor) {
                (Some(part), Some(_)) => {
                    let has = *has_mate.entry((part, other)).or_insert_with(|| has(part, other));
                    let count = if has { &mut far } else { &mut alone };
                    *count += 1;
                }
                _ => unknown += 1,
            }
        }
        let Within { mm, deg } = self.within;
        let reasons = [
            (
                far,
                format!(
                    "touches mate with none: nothing of the other side within {mm} mm and {deg} degrees, or it has a nearer mate"
                ),
            ),
            (alone, "touches mate with none: their part was touched on one side only".to_owned()),
            (unknown, "touches mate with none: part or pose is not known".to_owned()),
        ];
        self.notes.extend(reasons.into_iter().filter(|(n, _)| *n > 0).map(|(n, why)| format!("{n} {why}")));
    }
}

impl Within {
    /// How far apart two poses are, as a share of the tolerance; `None` beyond it.
    fn off(&self, a: &Se2, b: &Se2) -> Option<f64> {
        let turned = wrap_angle(a.theta_rad - b.theta_rad).to_degrees().abs() / self.deg;
        let off = (a.distance_mm(b) / self.mm).max(turned);
        (off <= 1.0).then_some(off)
    }
}

/// Holds out the boards that the dataset names.
fn split_by_name(dataset: &Dataset, pairs: Vec<Pair>) -> (Vec<Pair>, Vec<Vec<Pair>>) {
    let boards = &dataset.meta().held_out;
    let mut training = Vec::new();
    let mut held_out = vec![Vec::new(); boards.len()];
    for pair in pairs {
        match boards.iter().position(|board| Some(board) == dataset.touch(pair.hole).part.as_ref()) {
            Some(board) => held_out[board].push(pair),
            None => training.push(pair),
        }
    }
    (training, held_out)
}

/// Holds out boards, or regions of them.
fn split(dataset: &Dataset, pairs: Vec<Pair>, notes: &mut Vec<String>) -> (Vec<Pair>, Vec<Vec<Pair>>) {
    if pairs.len() < MIN_PAIRS {
        return (pairs, Vec::new());
    }
    let mut boards: Vec<(Option<&str>, Vec<Pair>)> = Vec::new();
    for pair in pairs {
        let part = dataset.touch(pair.hole).part.as_deref();
        match boards.iter_mut().find(|(board, _)| *board == part) {
            Some((_, pairs)) => pairs.push(pair),
            None => boards.push((part, vec![pair])),
        }
    }
    if boards.len() >= MANY_BOARDS {
        let n_held_out = boards.len() / HELD_OUT;
        let held_out = boards.split_off(boards.len() - n_held_out);
        notes.push(format!("{n_held_out} of {} boards are held out", boards.len() + n_held_out));
        let training = boards.into_iter().flat_map(|(_, pairs)| pairs);
        return (training.collect(), held_out.into_iter().map(|(_, pairs)| pairs).collect());
    }
    let meta = dataset.meta();
    let margin_mm = 0.25 * meta.field_of_view_mm().iter().sum::<f64>();
    let (mut training, mut held_out, mut n_near) = (Vec::new(), Vec::new(), 0);
    for (_, pairs) in boards {
        let (inside, outside) = region(dataset, pairs);
        let is_near = |pair: &Pair| {
            let pose = |pair: &Pair| dataset.touch(pair.peg).part_from_sensor;
            let Some(at) = pose(pair) else { return false };
            inside.iter().filter_map(pose).any(|held| held.distance_mm(&at) < margin_mm)
        };
        let (near, kept): (Vec<Pair>, Vec<Pair>) = outside.into_iter().partition(is_near);
        n_near += near.len();
        training.extend(kept);
        held_out.push(inside);
    }
    let n_held_out: usize = held_out.iter().map(Vec::len).sum();
    if n_held_out > 0 {
        notes.push(format!(
            "{n_held_out} pairs in a region of each board are held out; {n_near} nearer to it than {margin_mm:.1} mm are not used"
        ));
    }
    (training, held_out)
}

/// The held-out pairs of a board and the others: the twelfth furthest along x, or every twelfth where poses are not
/// known.
fn region(dataset: &Dataset, pairs: Vec<Pair>) -> (Vec<Pair>, Vec<Pair>) {
    let x_of = |pair: &Pair| dataset.touch(pair.peg).part_from_sensor.map(|pose| pose.x_mm);
    let mut xs: Vec<f64> = pairs.iter().filter_map(x_of).collect();
    if xs.len() < pairs.len() {
        let is_held = |(n, _): &(usize, Pair)| n % HELD_OUT == HELD_OUT - 1;
        let (inside, outside): (Vec<_>, Vec<_>) = pairs.into_iter().enumerate().partition(is_held);
        let pairs = |of: Vec<(usize, Pair)>| of.into_iter().map(|(_, pair)| pair).collect();
        return (pairs(inside), pairs(outside));
    }
    xs.sort_by(|a, b| b.total_cmp(a));
    let edge = xs.get(xs.len() / HELD_OUT).copied().unwrap_or(f64::INFINITY);
    pairs.into_iter().partition(|pair| x_of(pair).is_some_and(|x| x > edge))
}

#[cfg(test)]
mod tests {
    use super::*;
    use tactile_data::dataset::store::{DatasetWriter, Meta};
    use tactile_data::frame::Frame;

    const WITHIN: Within = Within { mm: 1.0, deg: 3.0 };

    fn dataset(touches: &[Touch]) -> Dataset {
        let meta = Meta::new("t", "a test", [4, 2], [4.65, 7.15]);
        let folder = tempfile::tempdir().unwrap();
        let frame = Frame::new(4, 2, (0..24).collect()).unwrap();
        let out = folder.path().join("d");
        let mut writer = DatasetWriter::create(&out, meta, &frame).unwrap();
        touches.iter().for_each(|touch| writer.push(&frame, touch).unwrap());
        writer.finish().unwrap();
        Dataset::open(&out).unwrap()
    }

    fn touch(part: &str, side: Side, x: f64, deg: f64) -> Touch {
        let part_from_sensor = Some(Se2::from_degrees(x, 0.0, deg));
        Touch { part: Some(part.into()), side: Some(side), part_from_sensor, ..Touch::default() }
    }

    fn mates(found: &Mating) -> Vec<(usize, usize)> {
        let mut all: Vec<_> =
            found.training.iter().chain(found.held_out.iter().flatten()).map(|p| (p.hole, p.peg)).collect();
        all.sort_unstable();
        all
    }

    #[test]
    fn the_nearest_peg_mates_and_each_only_once() {
        use Side::{Hole, Peg};
        let touches = [
            touch("a", Hole, 0.0, 0.0),
            touch("b", Peg, 0.0, 0.0), // another part
            touch("a", Peg, 0.3, 1.0),
            touch("a", Peg, 0.8, 0.0), // its hole has a nearer one
            touch("a", Hole, 9.0, 179.5),
            touch("a", Peg, 9.1, -179.5), // a turn of one degree
            touch("a", Hole, 20.0, 0.0),  // nothing near
            touch("a", Peg, 20.0, 9.0),   // turned too far
        ];
        let found = find(&dataset(&touches), WITHIN);
        assert_eq!(mates(&found), [(0, 2), (4, 5)]);
        let moved = found.training[0].sensor_from_hole.unwrap();
        let expected = touches[2].part_from_sensor.unwrap().inverse() * touches[0].part_from_sensor.unwrap();
        assert_eq!(moved, expected);
        let notes = found.notes.join("; ");
        assert!(notes.contains("2 holes mate") && notes.contains("3 touches mate with none: nothing"), "{notes}");
        assert!(notes.contains("1 touches mate with none: their part was touched on one side only"), "{notes}");
    }

    #[test]
    fn a_named_pair_mates_whatever_its_poses_say() {
        let named = |touch: Touch, name: &str| Touch { pair: Some(name.into()), ..touch };
        let touches = [
            named(touch("a", Side::Hole, 0.0, 0.0), "7"),
            touch("a", Side::Peg, 0.0, 0.0),
            named(touch("a", Side::Peg, 5.0, 0.0), "7"),
            named(touch("a", Side::Hole, 9.0, 0.0), "8"),
        ];
        let found = find(&dataset(&touches), WITHIN);
        assert_eq!(mates(&found), [(0, 2)]);
        assert_eq!(found.training.first().unwrap().sensor_from_hole, None);
        assert!(found.notes[0].starts_with("1 of 2 named pairs"), "{:?}", found.notes);
    }

    #[test]
    fn few_boards_hold_out_a_region_and_many_hold_out_boards() {
        let board = |name: String| {
            (0..48).flat_map(move |i| [Side::Hole, Side::Peg].map(|side| touch(&name, side, f64::from(i), 0.0)))
        };
        let few: Vec<Touch> = board("a".into()).collect();
        let found = find(&dataset(&few), WITHIN);
        let x = |pair: &Pair| few[pair.peg].part_from_sensor.unwrap().x_mm;
        assert_eq!(found.held_out[0].iter().map(x).collect::<Vec<_>>(), [44.0, 45.0, 46.0, 47.0]);
        // Views of 18.6 x 14.3 mm: half of their mean side is 8.2 mm.
        assert_eq!(found.training.iter().map(x).fold(0.0, f64::max), 35.0);
        let many: Vec<Touch> = (0..24).flat_map(|n| board(format!("b{n}"))).collect();
        let found = find(&dataset(&many), WITHIN);
        assert_eq!((found.held_out.len(), found.training.len()), (2, 22 * 48));
    }
}
