//! `tactile-infer embed`: pictures in, embeddings out; the least that a program of one's own has to do.

use std::path::PathBuf;

use clap::Args;
use serde::Serialize;
use tactile_data::dataset::touch::Side;
use tactile_data::file::output;
use tactile_data::frame::TactileImage;
use tactile_data::frame::npy;
use tactile_data::frame::picture;
use tactile_data::light::calibrate::Calibration;
use tactile_data::program::{self, named};
use tactile_infer::bank::similarity::dot;
use tactile_infer::{Model, Result};

use super::{ModelArgs, print_json};

#[derive(Args)]
pub struct EmbedArgs {
    /// Pictures of touches, PNG or JPEG, all of the size of the no-contact frame
    #[arg(required = true, value_name = "IMAGE")]
    images: Vec<PathBuf>,
    #[command(flatten)]
    model: ModelArgs,
    /// Picture of the sensor at rest, from the same camera; the network sees the difference from it
    #[arg(long, value_name = "IMAGE")]
    no_contact: PathBuf,
    /// The sensor's light over these pictures, as `tactile-data calibrate` measured it [default: a GelSight Mini's]
    #[arg(long, value_name = "FILE.toml")]
    calibration: Option<PathBuf>,
    /// Embed as touches of holes (queries, `predictor(encoder(image))`) or as views of pegs (keys, `encoder(image)`)
    #[arg(long, value_name = "SIDE", default_value_t, value_parser = named::<Side>(Side::NAMES))]
    side: Side,
    /// Also write what the network sees, f4 of [n, 3, height, width], for a check by another program
    #[arg(long, value_name = "FILE.npy")]
    dump_input: Option<PathBuf>,
    /// Print the embeddings as JSON
    #[arg(long)]
    json: bool,
}

/// What `--json` prints.
#[derive(Serialize)]
struct Embedded<'a> {
    model_sha256: &'a str,
    side: Side,
    dim: usize,
    images: Vec<Row<'a>>,
}

/// One image.
#[derive(Serialize)]
struct Row<'a> {
    file: String,
    /// Share of the view that shows an edge, 0..=1.
    edge_share: f32,
    /// `[dim]`, of unit length.
    embedding: &'a [f32],
}

impl EmbedArgs {
    /// Embeds and prints.
    pub fn run(&self) -> Result<()> {
        let inputs = self.images.iter().chain([&self.no_contact, &self.model.path]);
        let _lock = self.dump_input.as_ref().map(|path| output::check_file(path, inputs)).transpose()?;
        let model = self.model.load()?;
        let images = self.tactile_images(&model)?;
        if let Some(path) = &self.dump_input {
            let [width, height] = model.config().input_px;
            let planes: Vec<f32> = images.iter().flat_map(|image| image.planes.iter().copied()).collect();
            npy::write(path, &[images.len(), 3, height, width], &planes)?;
        }
        let rows = model.embed_side(&images, self.side)?;
        let named = self.images.iter().zip(&images).zip(rows.chunks_exact(model.dim()));
        let images = named.map(|((path, image), embedding)| {
            let file = path.display().to_string();
            Row { file, edge_share: image.edge_share, embedding }
        });
        let (model_sha256, dim) = (model.sha256(), model.dim());
        let embedded = Embedded { model_sha256, side: self.side, dim, images: images.collect() };
        if self.json {
            return print_json(&embedded);
        }
        print_rows(&embedded.images);
        Ok(())
    }

    /// What the network sees of each picture.
    fn tactile_images(&self, model: &Model) -> Result<Vec<TactileImage>> {
        let rest = &self.no_contact;
        let background = model.background(&picture::read(rest)?).map_err(|error| error.within(rest.display()))?;
        let calibration = self.calibration.as_ref().map(Calibration::load).transpose()?;
        let background = background.lit_by(&calibration.map(|of| of.light.response()))?;
        let seen = |path: &PathBuf| {
            let image = background.tactile_image(&picture::read(path)?);
            Ok(image.map_err(|error| error.within(path.display()))?)
        };
        self.images.iter().map(seen).collect()
    }
}

/// A line an image: its name and its embedding; after them the cosines of the images with each other.
fn print_rows(rows: &[Row<'_>]) {
    let width = rows.iter().map(|row| row.file.chars().count()).max().unwrap_or(0);
    for Row { file, embedding, .. } in rows {
        let values: Vec<String> = embedding.iter().map(|value| format!("{value:8.5}")).collect();
        program::say(format_args!("{file:width$} {}", values.join(" ")));
    }
    if rows.len() < 2 {
        return;
    }
    println!("\ncosine of each image with each:");
    for Row { file, embedding, .. } in rows {
        let cosines: Vec<String> =
            rows.iter().map(|other| format!("{:6.3}", dot(embedding, other.embedding))).collect();
        program::say(format_args!("{file:width$} {}", cosines.join(" ")));
    }
}
