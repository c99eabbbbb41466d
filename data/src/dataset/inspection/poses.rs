//! What is odd about the poses of touches.

use std::collections::{BTreeMap, HashMap};

use super::{Finding, Kind, is_continued, named};
use crate::dataset::touch::{Side, Touch};
use crate::pose::se2::{Se2, wrap_angle};

/// Poses nearer than this are one, mm: what an arm of a good robot repeats to.
const SAME_MM: f64 = 0.05;

/// And nearer than this, degrees.
const SAME_DEG: f64 = 0.1;

/// A pose whose nearest neighbour is this many times as far as is usual is an outlier. Of poses spread at random in
/// place and angle none in 10^30 is: the share of those without a neighbour up to r times the median is 2^-(r^3),
/// or 2^-(r^2) where only places vary. A decimal point in the wrong place is far beyond.
const LONELY_TIMES: f64 = 5.0;

/// Fewer different poses do not show what is usual.
const LEAST_POSES: usize = 10;

/// How far a turn by one degree moves what is 6 mm from the middle, as the mean pixel of a GelSight Mini is, mm.
const MM_PER_DEG: f64 = 0.1;

/// Poses of one part and side that several touches have, with different pictures (`digests`).
pub(super) fn repeated(touches: &[Touch], digests: &[u64]) -> Option<Finding> {
    type Cell<'a> = (Option<&'a str>, Option<Side>, [i64; 3]);
    let mut cells: HashMap<Cell, Vec<usize>> = HashMap::new();
    let mut pairs = Vec::new();
    for (frame, touch) in touches.iter().enumerate() {
        let Some(pose) = touch.part_from_sensor.filter(|_| !is_continued(touch)) else { continue };
        let (part, at) = (touch.part.as_deref(), cell(&pose));
        let around = neighbours(at).into_iter().filter_map(|at| cells.get(&(part, touch.side, at)));
        let is_same = |other: &&usize| touches[**other].part_from_sensor.is_some_and(|pose2| is_one(&pose, &pose2));
        let same: Vec<usize> = around.flatten().filter(is_same).copied().collect();
        if let Some(other) = same.iter().filter(|other| digests[**other] != digests[frame]).min() {
            pairs.push((*other, frame));
        } else if same.is_empty() {
            cells.entry((part, touch.side, at)).or_default().push(frame);
        }
    }
    let (first, second) = *pairs.first()?;
    let message = format!(
        "{} touch(es) at a pose that the part was touched at before, with another picture: first frames {first} and \
         {second}",
        pairs.len()
    );
    Some(Finding { kind: Kind::RepeatedPose, message, frames: pairs.into_iter().map(|(_, frame)| frame).collect() })
}

fn is_one(a: &Se2, b: &Se2) -> bool {
    a.distance_mm(b) <= SAME_MM && wrap_angle(a.theta_rad - b.theta_rad).abs().to_degrees() <= SAME_DEG
}

/// Cells of an angle: a turn is a whole number of them.
const ANGLE_CELLS: i64 = (360.0 / SAME_DEG) as i64;

/// The cell of a pose: poses that are one are in the same or in neighbours.
fn cell(pose: &Se2) -> [i64; 3] {
    let theta = (pose.theta_deg() / SAME_DEG).floor() as i64;
    [(pose.x_mm / SAME_MM).floor() as i64, (pose.y_mm / SAME_MM).floor() as i64, theta.rem_euclid(ANGLE_CELLS)]
}

fn neighbours([x, y, theta]: [i64; 3]) -> Vec<[i64; 3]> {
    let around = |n: i64| [n - 1, n, n + 1];
    let angles = around(theta).map(|theta| theta.rem_euclid(ANGLE_CELLS));
    let places = around(x).into_iter().flat_map(|x| around(y).map(|y| [x, y]));
    places.flat_map(|[x, y]| angles.map(|theta| [x, y, theta])).collect()
}

/// Poses far from every other, of whatever part: a slip of the pen, or a lost decimal point.
pub(super) fn lonely(touches: &[Touch]) -> Option<Finding> {
    let mut frames_at: BTreeMap<[i64; 3], (Se2, Vec<usize>)> = BTreeMap::new();
    for (frame, touch) in touches.iter().enumerate() {
        if let Some(pose) = touch.part_from_sensor {
            frames_at.entry(cell(&pose)).or_insert((pose, Vec::new())).1.push(frame);
        }
    }
    if frames_at.len() < LEAST_POSES {
        return None;
    }
    let poses: Vec<Se2> = frames_at.values().map(|(pose, _)| *pose).collect();
    let nearest = nearest_neighbours(&poses);
    let mut sorted = nearest.clone();
    sorted.sort_by(f64::total_cmp);
    let usual_mm = sorted[sorted.len() / 2];
    let is_lonely = |distance_mm: f64| distance_mm > LONELY_TIMES * usual_mm;
    let lonely = frames_at.into_values().zip(&nearest).filter(|(_, mm)| is_lonely(**mm));
    let (mut frames, mut most_mm) = (Vec::new(), 0.0_f64);
    for ((_, at_pose), distance_mm) in lonely {
        frames.extend(at_pose);
        most_mm = most_mm.max(*distance_mm);
    }
    frames.sort_unstable();
    let message = format!(
        "{} touch(es) with a pose far from every other, by up to {most_mm:.1} mm (a degree counted as {MM_PER_DEG} mm), \
         where {usual_mm:.2} mm is usual: frames {}",
        frames.len(),
        named(&frames)
    );
    (!frames.is_empty()).then_some(Finding { kind: Kind::LonelyPose, message, frames })
}

/// The distance from each of at least two poses to its nearest neighbour, mm.
fn nearest_neighbours(poses: &[Se2]) -> Vec<f64> {
    let coordinates = |pose: &Se2| [pose.x_mm, pose.y_mm, MM_PER_DEG * pose.theta_deg()];
    let spread = |axis: usize| {
        let values = poses.iter().map(|pose| coordinates(pose)[axis]);
        values.clone().fold(f64::MIN, f64::max) - values.fold(f64::MAX, f64::min)
    };
    // In order of the place along the longest side only few need to be compared. The angle has no order.
    let axis = usize::from(spread(1) > spread(0));
    let mut order: Vec<usize> = (0..poses.len()).collect();
    order.sort_by(|a, b| coordinates(&poses[*a])[axis].total_cmp(&coordinates(&poses[*b])[axis]));
    let distance = |a: usize, b: usize| {
        let turned_mm = MM_PER_DEG * wrap_angle(poses[a].theta_rad - poses[b].theta_rad).to_degrees();
        poses[a].distance_mm(&poses[b]).hypot(turned_mm)
    };
    let mut nearest = vec![f64::INFINITY; poses.len()];
    for (at, &this) in order.iter().enumerate() {
        let mut look = |others: &mut dyn Iterator<Item = &usize>| {
            for &other in others {
                let apart = (coordinates(&poses[other])[axis] - coordinates(&poses[this])[axis]).abs();
                if apart > nearest[this] {
                    break;
                }
                nearest[this] = nearest[this].min(distance(this, other));
            }
        };
        look(&mut order[at + 1..].iter());
        look(&mut order[..at].iter().rev());
    }
    nearest
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scene::random::{around_zero, frame_rng};

    #[test]
    fn nearest_neighbours_are_those_of_a_look_at_all_pairs() {
        let mut rng = frame_rng(1, 2);
        let poses: Vec<Se2> = (0..200)
            .map(|_| {
                Se2::from_degrees(around_zero(&mut rng, 5.0), around_zero(&mut rng, 9.0), around_zero(&mut rng, 180.0))
            })
            .collect();
        let got = nearest_neighbours(&poses);
        for (at, pose) in poses.iter().enumerate() {
            let others = poses.iter().enumerate().filter(|(other, _)| *other != at).map(|(_, other)| {
                let mut degrees = (pose.theta_deg() - other.theta_deg()).abs();
                degrees = degrees.min(360.0 - degrees);
                ((pose.x_mm - other.x_mm).powi(2) + (pose.y_mm - other.y_mm).powi(2) + (0.1 * degrees).powi(2)).sqrt()
            });
            let expected = others.fold(f64::INFINITY, f64::min);
            assert!((got[at] - expected).abs() < 1e-9, "{at}: {}, {expected}", got[at]);
        }
    }

    #[test]
    fn poses_that_are_one_are_in_neighbouring_cells_also_at_half_a_turn() {
        for (a, b) in [([0.049, 0.0, 180.0], [0.051, 0.0, -179.95]), ([-0.01, 3.0, 0.02], [0.01, 3.02, -0.02])] {
            let pose = |[x, y, theta]: [f64; 3]| Se2::from_degrees(x, y, theta);
            assert!(is_one(&pose(a), &pose(b)));
            assert!(neighbours(cell(&pose(a))).contains(&cell(&pose(b))), "{a:?}");
        }
    }
}
