//! `tactile-infer speed`: how long the encoder takes.

use std::time::{Duration, Instant};

use clap::Args;
use serde::Serialize;
use tactile_data::frame::TactileImage;
use tactile_infer::{Error, Result};

use super::ModelArgs;

/// Images in the large batch.
const BATCH: usize = 64;

#[derive(Args)]
pub struct SpeedArgs {
    #[command(flatten)]
    model: ModelArgs,
    /// How long to measure each, s
    #[arg(long, default_value_t = 1.0)]
    seconds: f64,
    /// Print the figures as JSON
    #[arg(long)]
    json: bool,
}

/// Medians.
#[derive(Serialize)]
struct Speed {
    one_image_ms: f64,
    images_per_second: f64,
}

impl SpeedArgs {
    /// Measures and prints.
    pub fn run(&self) -> Result<()> {
        if !(0.01..=60.0).contains(&self.seconds) {
            return Err(Error::invalid("--seconds", "0.01..=60", self.seconds.to_string()));
        }
        let model = self.model.load()?;
        let size_px = model.config().input_px;
        let planes = (0..3 * size_px[0] * size_px[1]).map(|i| (i as f32 * 0.7).sin()).collect();
        let image = TactileImage { size_px, planes, edge_share: 0.5 };
        let median = |n: usize| -> Result<Duration> {
            let images = vec![image.clone(); n];
            let (mut times, began) = (Vec::new(), Instant::now());
            model.embed_holes(&images)?;
            while began.elapsed().as_secs_f64() < self.seconds || times.len() < 3 {
                let start = Instant::now();
                model.embed_holes(&images)?;
                times.push(start.elapsed());
            }
            times.sort_unstable();
            Ok(times[times.len() / 2])
        };
        let speed = Speed {
            one_image_ms: 1e3 * median(1)?.as_secs_f64(),
            images_per_second: BATCH as f64 / median(BATCH)?.as_secs_f64(),
        };
        if self.json {
            return super::print_json(&speed);
        }
        let Speed { one_image_ms, images_per_second } = speed;
        println!("one image {one_image_ms:.2} ms; {images_per_second:.0} images/s in batches of {BATCH}");
        Ok(())
    }
}
