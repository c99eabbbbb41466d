//! What the touches of a scene are made of.

use sha2::{Digest, Sha256};

use super::{Parts, Scene};
use crate::dataset::origin::{Origin, PartOrigin, SensorOrigin};
use crate::sensor::light::LightRig;

impl Scene {
    /// What a scene's touches are made of: the parts with the sizes of their outlines, and the sensor. A size is `None`
    /// where an outline cannot be made, because its file is gone, and for MAZE boards.
    pub fn origin(&self) -> Origin {
        let size_mm = |part: usize| match &self.parts {
            Parts::Maze(_) => None,
            Parts::Kit(kit) => {
                let [x_min, y_min, x_max, y_max] = kit.part(part, self.clearance_mm).ok()?.bounds();
                Some([x_max - x_min, y_max - y_min])
            }
        };
        let names = self.part_names().into_iter().enumerate();
        Origin {
            name: self.name.clone(),
            parts: names.map(|(part, name)| PartOrigin { name, size_mm: size_mm(part) }).collect(),
            sensor: SensorOrigin {
                field_of_view_mm: self.sensor.field_of_view_mm,
                light: Some(light_name(&self.sensor.light)),
                is_relit: self.sensor.known_lamps().is_some(),
            },
        }
    }
}

/// The name of a known rig; of any other the start of the SHA-256 of its numbers.
fn light_name(light: &LightRig) -> String {
    let known = LightRig::NAMES.into_iter().find(|name| LightRig::named(name).is_ok_and(|rig| rig == *light));
    known.map_or_else(
        || {
            let bytes = serde_json::to_vec(light).unwrap_or_default();
            Sha256::digest(bytes).iter().take(6).map(|byte| format!("{byte:02x}")).collect()
        },
        Into::into,
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn another_board_or_sensor_is_another_origin() {
        let scene = |name: &str| Scene::preset(name).unwrap();
        let small = scene("alphabet-small").origin();
        // Letters of 12 mm, with the clearance of both sides.
        let height = small.parts[0].size_mm.unwrap()[1];
        assert!((12.0..13.0).contains(&height), "{height}");
        assert_eq!(small.other_parts(&scene("alphabet-small-hard").origin()), None);
        let large = scene("alphabet-large").origin();
        assert_eq!(small.other_parts(&large).unwrap()[0], "size of part A");
        assert_eq!(small.other_parts(&scene("connectors").origin()).unwrap()[0], "parts");
        let lit = |light: LightRig| {
            let mut scene = scene("alphabet-small");
            scene.sensor.light = light;
            scene.origin()
        };
        let cmu = lit(LightRig::named("cmu").unwrap());
        // Its pictures are brought under a Mini's lamps.
        assert_eq!((cmu.sensor.light.as_deref(), cmu.sensor.is_relit), (Some("cmu"), true));
        assert_eq!(small.other_sensor(&cmu), None);
        let own = lit(LightRig::lamps([80.0, 50.0, 53.0], [83.0, -174.0, -97.0]));
        assert_eq!(own.sensor.light.as_ref().map(String::len), Some(12));
        assert!(small.other_sensor(&own).is_none() && own.other_sensor(&own).is_none());
    }
}
