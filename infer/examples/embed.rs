//! Embeds frames of touches: two touches of one part are alike, two of different parts are not.
//!
//!     cargo run --release --example embed [MODEL]
//!
//! The frames are simulated here; `tactile_data::frame::picture::read` reads yours from PNG or JPEG.

use std::error::Error;
use std::path::PathBuf;

use tactile_data::dataset::touch::Side;
use tactile_data::pose::se2::Se2;
use tactile_data::scene::Scene;
use tactile_data::sensor::simulator::{Simulator, frame_rng};
use tactile_infer::Model;
use tactile_infer::bank::similarity::dot;

fn main() -> Result<(), Box<dyn Error>> {
    let shipped = concat!(env!("CARGO_MANIFEST_DIR"), "/models/maze-small.safetensors");
    let model = Model::load(&std::env::args_os().nth(1).map_or_else(|| shipped.into(), PathBuf::from))?;
    let simulator = Simulator::new(Scene::load("alphabet-small")?, 1)?;

    // The sensor at rest once, then each touch.
    let background = model.background(&simulator.no_contact(7))?;
    let pose = Se2::from_degrees(2.0, 0.0, 15.0);
    let touch = |part: usize, side: Side, stream: u64| -> Result<_, Box<dyn Error>> {
        let frame = simulator.touch(part, side, &pose, &mut frame_rng(7, stream))?;
        Ok(background.tactile_image(&frame)?)
    };
    let [a, b] = [0, 1];
    let holes = model.embed_holes(&[touch(a, Side::Hole, 1)?])?; // [1, dim], of unit length
    let pegs = model.embed_pegs(&[touch(a, Side::Peg, 2)?, touch(b, Side::Peg, 3)?])?; // [2, dim]
    let names = simulator.parts();
    for (part, peg) in pegs.chunks_exact(model.dim()).enumerate() {
        println!("cosine of the hole of {} with the peg of {}: {:.2}", names[a], names[part], dot(&holes, peg));
    }
    Ok(())
}
