//! From a bag to a dataset.

use std::collections::VecDeque;
use std::path::Path;

use rayon::prelude::*;

use crate::dataset::store::{self, DatasetWriter, Meta};
use crate::dataset::touch::{Side, Touch};
use crate::error::{Error, Result};
use crate::frame::Frame;
use crate::frame::picture;
use crate::pose::se2::Se2;
use crate::recording::contact::{self, FrameContact};
use crate::recording::folder::NoContact;
use crate::recording::geometry::{Geometry, View};
use crate::recording::pipeline::{Item, Picture, push};
use crate::recording::rest;
use crate::recording::ros::bag::{Bag, Message, Messages};
use crate::recording::ros::choice;
use crate::recording::ros::messages::{Image, Message as _};
use crate::recording::ros::picture::{Shown, of_compressed, of_image};
use crate::recording::ros::placement::{Placement, Placer};
use crate::recording::ros::pose_track::PoseTrack;
use crate::recording::ros::survey::Survey;
use crate::recording::ros::touches::{self, Picked, Touches};

/// Frames whose contact is judged at once, on all cores.
const BATCH: usize = 64;

/// How a bag is read.
#[derive(Clone, Debug)]
pub struct Import {
    /// The topic of pictures; `None`: the only one.
    pub image_topic: Option<String>,
    /// Where poses come from.
    pub poses: PoseSource,
    /// Which frames are touches; `None`: judged from the bag.
    pub touches: Option<Touches>,
    /// Farthest in time that a pose may be from its frame, ms.
    pub max_gap_ms: f64,
    /// The part that was touched; `None`: the name behind the `/` of the poses' frame, `hole/NAME` or `peg/NAME`.
    pub part: Option<String>,
    /// Its side; `None`: from the poses' frame.
    pub side: Option<Side>,
    /// Pose of the sensor in the frame whose pose the bag has.
    pub tool_from_sensor: Option<Se2>,
    /// Pose of the part in the frame in which the bag's poses are.
    pub board: Option<Se2>,
    /// Where the frame at rest comes from; a picture's file, or the film's first frames.
    pub no_contact: NoContact,
    /// How pictures, and the frame at rest with them, become frames.
    pub geometry: Geometry,
}

/// Where a bag's poses come from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum PoseSource {
    /// The only topic of poses, where there is one.
    Guess,
    /// This topic.
    Topic(String),
    /// The transforms between these frames, the base first, the sensor or tool second.
    Frames([String; 2]),
}

/// What an import did.
#[derive(Clone, Debug)]
pub struct Imported {
    /// Number of frames written.
    pub n_frames: usize,
    /// What was read and how well it fits, one line each.
    pub notes: Vec<String>,
    /// What a person should know, one line each.
    pub warnings: Vec<String>,
}

/// Imports the bag `source`, an MCAP file or a folder of them (with the feature `ros1` ROS 1 bags too), to a dataset at
/// `out`. `progress` gets the touches done and all touches.
///
/// # Errors
/// A bag that cannot be read, topics that are not clear, no touch in it.
pub fn import(source: &Path, how: &Import, out: &Path, progress: &dyn Fn(usize, usize)) -> Result<Imported> {
    if !(how.max_gap_ms >= 0.0 && how.max_gap_ms.is_finite()) {
        return Err(Error::invalid("--max-gap-ms", "0 ms or more", format!("{}", how.max_gap_ms)));
    }
    let bag = Bag::open(source)?;
    let mut survey = Survey::of(&bag, matches!(how.poses, PoseSource::Frames(_)))?;
    let mut warnings = std::mem::take(&mut survey.cuts);
    let mut notes = Vec::new();
    let film = Film::choose(&bag, &mut survey, how, source, (&mut notes, &mut warnings))?;
    let no_contact = film.no_contact(&how.no_contact, &mut warnings)?;
    let view = how.geometry.settle(&no_contact, &mut warnings)?;
    let meta = meta(&bag, source, &view)?;
    store::meta::check_meta(&meta, out)?;

    let (mode, picked) = film.touches(how, &no_contact)?;
    let n_touches = picked.picks.len();
    notes.push(format!("touches    {}: {n_touches} taken, {} left out", mode.name(), picked.n_left_out));
    if n_touches == 0 {
        let expected = format!("at least one touch ({})", mode.name());
        let got = format!("none in {} frames, {} left out", film.times_ns.len(), picked.n_left_out);
        return Err(Error::invalid(source.display().to_string(), expected, got));
    }
    let touches = place_touches(&film, how, picked, (&mut notes, &mut warnings));
    let writer = DatasetWriter::create(out, meta, &view.frame(&no_contact, "no-contact frame")?)?;
    let mut writer = writer.expecting(n_touches);
    let mut items = Items { film: &film, messages: film.messages().enumerate(), touches: touches.into(), shown: None };
    let n_frames = push(&mut items, n_touches, &view, &mut writer, progress)?;
    writer.finish()?;
    Ok(Imported { n_frames, notes, warnings })
}

fn meta(bag: &Bag, source: &Path, view: &View) -> Result<Meta> {
    let name = source.file_stem().unwrap_or(source.as_os_str());
    let meta = view.meta(name, format!("imported from the bag {}", source.display()));
    Ok(Meta { recording: Some(view.recording(bag.sha256()?)), ..meta })
}

/// The touches in order with their frames' numbers; says how well poses and frames fit.
fn place_touches(
    film: &Film,
    how: &Import,
    picked: Picked,
    (notes, warnings): (&mut Vec<String>, &mut Vec<String>),
) -> Vec<(usize, Touch)> {
    let placer = Placer { tool_from_sensor: how.tool_from_sensor, board: how.board };
    let mut placement = Placement::default();
    let mut touches = Vec::new();
    for pick in picked.picks {
        let frame_id = pick.pose.as_ref().map(|found| &*found.frame_id);
        let (side, part) = frame_id.and_then(side_and_part).unzip();
        let touch = Touch {
            part: how.part.clone().or(part),
            side: how.side.or(side),
            part_from_sensor: pick.pose.as_ref().map(|found| placement.note(&placer, found)),
            time_s: Some(seconds(film.times_ns[pick.frame])),
            ..Touch::default()
        };
        touches.push((pick.frame, touch));
    }
    notes.extend(placement.note_on_time());
    warnings.extend(placement.warnings());
    if touches.iter().any(|(_, touch)| touch.side.is_none() || touch.part.is_none()) {
        warnings.push("the part or its side is not known: --part and --side name them".to_owned());
    }
    touches
}

/// `hole/A` as a side and a part's name.
fn side_and_part(frame_id: &str) -> Option<(Side, String)> {
    let (side, part) = frame_id.trim_start_matches('/').split_once('/')?;
    Some((side.parse().ok()?, part.to_owned())).filter(|_| !part.is_empty())
}

/// Nanoseconds as seconds: the nearest number, as a decimal text is read, which no sum of a whole part and a rest is.
fn seconds(time_ns: i64) -> f64 {
    const SECOND: u64 = 1_000_000_000;
    let (sign, size) = (if time_ns < 0 { "-" } else { "" }, time_ns.unsigned_abs());
    format!("{sign}{}.{:09}", size / SECOND, size % SECOND).parse().unwrap_or(time_ns as f64 * 1e-9)
}

/// The pictures of a bag and the poses that go with them.
struct Film<'a> {
    bag: &'a Bag,
    topic: String,
    times_ns: Vec<i64>,
    track: PoseTrack,
}

impl<'a> Film<'a> {
    fn choose(
        bag: &'a Bag,
        survey: &mut Survey,
        how: &Import,
        source: &Path,
        (notes, warnings): (&mut Vec<String>, &mut Vec<String>),
    ) -> Result<Self> {
        let place = source.display().to_string();
        let topic = choice::picture_topic(survey, how.image_topic.as_deref(), &place)?;
        let times_ns = survey.pictures.remove(&topic).unwrap_or_default();
        let mut read = vec![topic.clone()];
        notes.push(format!("pictures   {topic} ({}): {} frames", survey.topics[&topic].type_name, times_ns.len()));
        let track = match &how.poses {
            PoseSource::Frames([base, sensor]) => {
                let track = PoseTrack::Chain(survey.transforms.chain([base, sensor])?, base.as_str().into());
                notes.push(format!("poses      {sensor} in {base}, moved {} times", track.times_ns().len()));
                track
            }
            poses => {
                let named = if let PoseSource::Topic(topic) = poses { Some(topic.as_str()) } else { None };
                match choice::pose_topic(survey, named, &place)? {
                    Some(topic) => {
                        let poses = survey.poses.remove(&topic).unwrap_or_default();
                        notes.push(format!("poses      {topic}: {} messages", poses.len()));
                        read.push(topic);
                        PoseTrack::of_topic(poses)
                    }
                    None => {
                        notes.push("poses      none".to_owned());
                        PoseTrack::None
                    }
                }
            }
        };
        for (name, topic) in
            survey.topics.iter().filter(|(name, topic)| topic.n_without_time > 0 && read.contains(name))
        {
            let (n, all) = (topic.n_without_time, topic.n_messages);
            warnings.push(format!("{name}: {n} of {all} headers have no time: the time of recording is taken"));
        }
        Ok(Self { bag, topic, times_ns, track })
    }

    /// The messages with the pictures, in order.
    fn messages(&self) -> PictureMessages<'_> {
        PictureMessages { messages: self.bag.messages(), topic: &self.topic }
    }

    fn no_contact(&self, how: &NoContact, warnings: &mut Vec<String>) -> Result<Frame> {
        if let Some(first) = self.messages().next() {
            warnings.extend(show(first?)?.0.guess);
        }
        let mut frames = self.messages().map(|message| {
            let (shown, place) = show(message?)?;
            Ok((decode(shown.picture, &place)?, place))
        });
        rest::find(how, &mut frames, warnings)
    }

    /// Which frames are touches, and by which rule.
    fn touches(&self, how: &Import, no_contact: &Frame) -> Result<(Touches, Picked)> {
        let n_frames = self.times_ns.len();
        let max_gap_ns = (how.max_gap_ms * 1e6) as i64;
        let n_poses = self.track.times_ns().len();
        if how.touches == Some(Touches::Poses) && n_poses == 0 {
            return Err(Error::invalid("--touches poses", "poses that change over time", "none in this bag"));
        }
        let picked = |frames: &mut dyn Iterator<Item = usize>| {
            touches::with_poses(frames, &self.times_ns, &self.track, max_gap_ns)
        };
        let by_poses = how.touches.is_none() && touches::poses_are_touches(n_poses, n_frames);
        if by_poses || how.touches == Some(Touches::Poses) {
            return Ok((Touches::Poses, touches::nearest_to_poses(&self.times_ns, &self.track, max_gap_ns)));
        }
        if how.touches == Some(Touches::Each) {
            return Ok((Touches::Each, picked(&mut (0..n_frames))));
        }
        let frames = self.contact(no_contact)?;
        let is_contact = |frame: &Result<FrameContact>| frame.as_ref().is_ok_and(FrameContact::is_contact);
        let n_contact = frames.iter().filter(|frame| is_contact(frame)).count();
        if how.touches == Some(Touches::Contact) || (1..n_frames).contains(&n_contact) {
            return Ok((Touches::Contact, picked(&mut touches::settled(&frames).into_iter())));
        }
        Ok((Touches::Each, picked(&mut (0..n_frames))))
    }

    /// How every frame differs from rest.
    fn contact(&self, no_contact: &Frame) -> Result<Vec<Result<FrameContact>>> {
        let background = contact::background(no_contact)?;
        let of = |message: Message| {
            let (shown, place) = show(message)?;
            Ok(FrameContact::of(&background.tactile_image(&decode(shown.picture, &place)?)?))
        };
        let mut messages = self.messages();
        let mut frames = Vec::with_capacity(self.times_ns.len());
        loop {
            let batch = messages.by_ref().take(BATCH).collect::<Result<Vec<Message>>>()?;
            if batch.is_empty() {
                return Ok(frames);
            }
            frames.extend(batch.into_par_iter().map(of).collect::<Vec<_>>());
        }
    }
}

/// The picture of a message, and the message's place.
fn show(message: Message) -> Result<(Shown, String)> {
    let place = message.place();
    let is_plain = message.channel.type_name == Image::TYPE;
    let shown = match is_plain {
        true => of_image(message.read()?, &place)?,
        false => of_compressed(message.read()?, &place)?,
    };
    Ok((shown, place))
}

fn decode(shown: Picture, place: &str) -> Result<Frame> {
    match shown {
        Picture::Encoded(bytes) => picture::decode(&bytes, place),
        Picture::Raw(frame) => Ok(frame),
    }
}

/// The messages of one topic.
struct PictureMessages<'a> {
    messages: Messages<'a>,
    topic: &'a str,
}

impl Iterator for PictureMessages<'_> {
    type Item = Result<Message>;

    fn next(&mut self) -> Option<Self::Item> {
        let is_other = |message: &Result<Message>| message.as_ref().is_ok_and(|m| m.channel.topic != self.topic);
        self.messages.by_ref().find(|message| !is_other(message))
    }
}

/// The pictures of the touches, read one at a time.
struct Items<'a> {
    film: &'a Film<'a>,
    messages: std::iter::Enumerate<PictureMessages<'a>>,
    /// Numbers of frames, in order.
    touches: VecDeque<(usize, Touch)>,
    /// The last frame that was read: its number, picture and place.
    shown: Option<(usize, Picture, String)>,
}

impl Iterator for Items<'_> {
    type Item = Result<Item>;

    fn next(&mut self) -> Option<Self::Item> {
        let (wanted, touch) = self.touches.pop_front()?;
        Some(self.picture(wanted).map(|(picture, place)| Item { picture, touch, place }))
    }
}

impl Items<'_> {
    /// The picture of a frame and its place; frames are asked for in order, the same one any number of times.
    fn picture(&mut self, wanted: usize) -> Result<(Picture, String)> {
        loop {
            if let Some((number, picture, place)) = &self.shown
                && *number == wanted
            {
                return Ok((picture.clone(), place.clone()));
            }
            let Some((number, message)) = self.messages.next() else {
                let expected = format!("{} frames, as a moment ago", self.film.times_ns.len());
                return Err(Error::invalid(&self.film.topic, expected, "fewer"));
            };
            let message = message?;
            if number == wanted {
                let (shown, place) = show(message)?;
                self.shown = Some((number, shown.picture, place));
            }
        }
    }
}

#[cfg(test)]
#[path = "import_tests.rs"]
pub(super) mod tests;
