//! Options of every program that touches in simulation: another sensor than the scene's.

use clap::Args;

use crate::scene::SensorRange;
use crate::sensor::SensorSpec;

/// Another sensor than the scene's, drawn.
#[derive(Args)]
pub struct DrawnArgs {
    /// With --scene: touch with the N-th of the sensors that a user may have instead of the scene's: other camera, gel and light field,
    /// pressed 0.6 to 1.5 times as deep
    #[arg(long, value_name = "N", requires = "scene")]
    drawn_sensor: Option<u64>,
    /// With --scene: touch under the N-th of the lights that a unit may have which nobody measured: lamps turned by up to 20 degrees,
    /// 0.7 to 1.4 times as strong, fading otherwise
    #[arg(long, value_name = "N", requires = "scene")]
    drawn_light: Option<u64>,
}

impl DrawnArgs {
    /// The first of these options that is given.
    pub fn flag(&self) -> Option<&'static str> {
        let flags = [("--drawn-sensor", self.drawn_sensor), ("--drawn-light", self.drawn_light)];
        flags.into_iter().find_map(|(flag, number)| number.map(|_| flag))
    }

    /// The sensor that touches in place of the scene's.
    pub fn sensor(&self, spec: &SensorSpec) -> SensorSpec {
        let drawn = self.drawn_sensor.map_or_else(|| spec.clone(), |number| SensorRange::another(spec, number));
        match self.drawn_light {
            Some(number) => SensorRange::another_light(&drawn, number),
            None => drawn,
        }
    }
}
