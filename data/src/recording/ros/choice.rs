//! Which topics of a bag are read.

use crate::error::{Error, Result};
use crate::recording::ros::survey::{Survey, is_picture, is_pose};
use crate::text::suggest::with_closest;

/// The topic of pictures: the one that is named, or the only one.
///
/// # Errors
/// None, several without a name, or a name that is not one of them.
pub fn picture_topic(survey: &Survey, named: Option<&str>, place: &str) -> Result<String> {
    let topic = choose(survey, is_picture, named, [place, "--image-topic", "a topic of pictures"])?;
    topic.ok_or_else(|| {
        let all: Vec<String> = survey.topics.iter().map(|(name, topic)| shown(name, &topic.type_name)).collect();
        let got = if all.is_empty() { "no messages".to_owned() } else { all.join(", ") };
        Error::invalid(place, "a topic of sensor_msgs/msg/Image or CompressedImage", got)
    })
}

/// The topic of poses: the one that is named, or the only one, or none.
///
/// # Errors
/// Several without a name, or a name that is not one of them.
pub fn pose_topic(survey: &Survey, named: Option<&str>, place: &str) -> Result<Option<String>> {
    choose(survey, is_pose, named, [place, "--pose-topic", "a topic of poses"])
}

fn choose(
    survey: &Survey,
    is_wanted: fn(&str) -> bool,
    named: Option<&str>,
    [place, flag, kind]: [&str; 3],
) -> Result<Option<String>> {
    let candidates = || survey.topics.iter().filter(|(_, topic)| is_wanted(&topic.type_name));
    let names: Vec<&str> = candidates().map(|(name, _)| name.as_str()).collect();
    match (named, names.as_slice()) {
        (Some(named), names) if names.contains(&named) => Ok(Some(named.to_owned())),
        (Some(named), names) => {
            let expected = if names.is_empty() { format!("{kind} in {place}") } else { names.join(", ") };
            Err(Error::invalid(flag, expected, with_closest(named, names.iter().copied())))
        }
        (None, []) => Ok(None),
        (None, [only]) => Ok(Some((*only).to_owned())),
        (None, _) => {
            let all: Vec<String> = candidates()
                .map(|(name, topic)| format!("{} with {} messages", shown(name, &topic.type_name), topic.n_messages))
                .collect();
            Err(Error::invalid(place, format!("{flag} with one of its topics"), all.join(", ")))
        }
    }
}

fn shown(name: &str, type_name: &str) -> String {
    format!("{name} ({})", if type_name.is_empty() { "no type" } else { type_name })
}
