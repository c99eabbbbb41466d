//! How the named peg is put into its hole, and what a try in vain tells.

use tactile_filter::insertion::{HeldPeg, Search};
use tactile_filter::{Episode, Error};

use crate::episode::tf_episode;
use crate::pointer::{fill, get, out};
use crate::status::{call, tf_status};
use crate::value::{flat, tf_pose, unflat};

/// A peg in the hand, above the hole that the filter named.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct tf_held_peg {
    /// By how much its hole is wider on every side, mm.
    pub play_mm: f64,
    /// From the origin of its part's frame to its farthest point, mm.
    pub radius_mm: f64,
    /// How well its pose in the hand is known: covariance over (x mm, y mm, theta rad) in the part's frame, row by row. After touches of
    /// the peg itself it is their tf_episode_offset_covariance(); zeros: exactly.
    pub covariance: [f64; 9],
    /// Poses at most, at least 1.
    pub most_poses: u32,
}

fn search(episode: &Episode, peg: &tf_held_peg) -> Result<Search, Error> {
    let tf_held_peg { play_mm, radius_mm, covariance, most_poses } = *peg;
    let peg = HeldPeg { play_mm, radius_mm, covariance: unflat(&covariance) };
    episode.estimate().search(&peg, most_poses as usize)
}

/// Where to slide the peg of the named part along the plate until it goes in. Each offset is by what the peg is moved from where its hole
/// is believed to be, in the part's frame: its pose from the sensor is tf_pose_compose(tf_pose_inverse(estimate.part_from_sensor),
/// offset). The likeliest comes first; the first is no motion. They are as near to each other as the play asks for.
/// \param covered   where the probability goes that the peg goes in at one of them, if its hole is near; null is allowed
/// \param required  where the number of offsets goes; with a capacity of 0 no offset is written
/// TF_STATUS_CONFIG: a play or a radius that is not above zero, or a covariance that is none.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_episode_search(
    episode: *const tf_episode,
    peg: *const tf_held_peg,
    covered: *mut f64,
    buffer: *mut tf_pose,
    capacity: usize,
    required: *mut usize,
) -> tf_status {
    call(|| unsafe {
        let (episode, peg) = (get(episode, "episode")?, get(peg, "peg")?);
        let found = search(&*episode.read()?, peg)?;
        let offsets: Vec<tf_pose> = found.offsets.iter().map(|offset| (*offset).into()).collect();
        fill(&offsets, buffer, capacity, required)?;
        if !covered.is_null() {
            out(covered, "covered")?.put(found.in_vain.covered);
        }
        Ok(())
    })
}

/// Takes in that the peg of the named part went in at none of the offsets that tf_episode_search() gives now for the same peg: the hole is
/// another part's, or elsewhere, or was missed. Touch again before the next try.
/// TF_STATUS_CONFIG: as tf_episode_search().
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_episode_did_not_fit(episode: *mut tf_episode, peg: *const tf_held_peg) -> tf_status {
    call(|| {
        let (episode, peg) = unsafe { (get(episode.cast_const(), "episode")?, get(peg, "peg")?) };
        let mut episode = episode.write()?;
        let found = search(&episode, peg)?;
        Ok(episode.did_not_fit(&found.in_vain)?)
    })
}

/// How well it is known where the named part is against where it is believed to be: covariance over (x mm, y mm, theta rad) in the part's
/// frame, row by row. Of an episode of touches of a held peg it is the covariance of that peg in the hand.
/// \param covariance  where the 9 numbers go
#[unsafe(no_mangle)]
pub unsafe extern "C" fn tf_episode_offset_covariance(episode: *const tf_episode, covariance: *mut f64) -> tf_status {
    call(|| unsafe {
        let estimate = get(episode, "episode")?.read()?.estimate();
        out(covariance.cast::<[f64; 9]>(), "covariance")?.put(flat(&estimate.offset_covariance()));
        Ok(())
    })
}
