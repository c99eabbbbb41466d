//! Bags for tests, written byte by byte from the specification (<https://mcap.dev/spec>), with what the writer of
//! `mcap` cannot do here: zstd and lz4.

use std::io::Write;
use std::path::Path;

use ruzstd::encoding::{CompressionLevel, compress_to_vec};

use crate::recording::ros::bag::Bag;
use crate::recording::ros::messages::{Header, Image, Message, Pose, PoseStamped, Time, to_cdr};

/// A message to write: topic, type, time of recording in nanoseconds, bytes.
pub type Sent = (&'static str, &'static str, u64, Vec<u8>);

/// What is read of messages: topic, time of recording in nanoseconds, bytes as they were before they were packed.
pub type Received = Vec<(String, i64, Vec<u8>)>;

/// What is to be read of messages that were sent.
pub fn expected(sent: &[Sent]) -> Received {
    sent.iter().map(|(topic, _, time, data)| ((*topic).to_owned(), *time as i64, data.clone())).collect()
}

/// All messages of a bag up to an error or the end, and what is said of the end.
pub fn read(path: &Path) -> (Received, String) {
    let bag = Bag::open(path).unwrap();
    let mut messages = bag.messages();
    let mut read = Vec::new();
    for message in &mut messages {
        match message {
            Ok(message) => {
                let (topic, time_ns) = (message.channel.topic.clone(), message.log_time_ns);
                read.push((topic, time_ns, message.unpacked().unwrap_or_default()));
            }
            Err(error) => return (read, error.to_string()),
        }
    }
    (read, messages.cuts().concat())
}

/// How a test's bag is packed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Packing {
    /// Records without chunks.
    NoChunks,
    /// Chunks with this name of a compression.
    Chunks(&'static str),
    /// Chunks without a compression, each message in zstd by itself.
    Messages,
}

pub const PACKINGS: [Packing; 5] =
    [Packing::NoChunks, Packing::Chunks(""), Packing::Chunks("zstd"), Packing::Chunks("lz4"), Packing::Messages];

pub fn bag(packing: Packing, sent: &[Sent]) -> Vec<u8> {
    let mut bytes = mcap::MAGIC.to_vec();
    record(&mut bytes, 1, &[string("ros2"), string("a test")].concat());
    let mut topics: Vec<&str> = Vec::new();
    for messages in sent.chunks(3) {
        let mut records = Vec::new();
        for (topic, type_name, time, data) in messages {
            let known = topics.iter().position(|known| known == topic);
            let id = known.unwrap_or(topics.len()) as u16 + 1;
            if known.is_none() {
                topics.push(topic);
                let text = string("definition");
                record(
                    &mut records,
                    3,
                    &[&id.to_le_bytes()[..], &string(type_name), &string("ros2msg"), &text].concat(),
                );
                let ids = [id.to_le_bytes(), id.to_le_bytes()].concat();
                record(&mut records, 4, &[ids, string(topic), string("cdr"), vec![0; 4]].concat());
            }
            let data = if packing == Packing::Messages { zstd(data) } else { data.clone() };
            let times = [time.to_le_bytes(), time.to_le_bytes()].concat();
            record(&mut records, 5, &[&id.to_le_bytes()[..], &[0; 4], &times, &data].concat());
        }
        match packing {
            Packing::NoChunks => bytes.extend(records),
            Packing::Chunks(name) => chunk(&mut bytes, name, &records),
            Packing::Messages => chunk(&mut bytes, "", &records),
        }
        // An index, which is skipped.
        record(&mut bytes, 7, &[0; 6]);
    }
    record(&mut bytes, 15, &[0; 4]);
    record(&mut bytes, 2, &[0; 20]);
    bytes.extend(mcap::MAGIC);
    bytes
}

fn chunk(bytes: &mut Vec<u8>, name: &str, records: &[u8]) {
    let packed = match name {
        "zstd" => zstd(records),
        "lz4" => lz4(records),
        _ => records.to_vec(),
    };
    let header = [
        &[0; 16][..],
        &(records.len() as u64).to_le_bytes(),
        &crc32fast::hash(records).to_le_bytes(),
        &string(name),
        &(packed.len() as u64).to_le_bytes(),
    ];
    record(bytes, 6, &[&header.concat()[..], &packed].concat());
}

fn record(bytes: &mut Vec<u8>, opcode: u8, body: &[u8]) {
    bytes.push(opcode);
    bytes.extend((body.len() as u64).to_le_bytes());
    bytes.extend(body);
}

fn string(text: &str) -> Vec<u8> {
    [&(text.len() as u32).to_le_bytes()[..], text.as_bytes()].concat()
}

fn zstd(bytes: &[u8]) -> Vec<u8> {
    compress_to_vec(bytes, CompressionLevel::Fastest)
}

fn lz4(bytes: &[u8]) -> Vec<u8> {
    let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
    encoder.write_all(bytes).unwrap();
    encoder.finish().unwrap()
}

pub fn header(time_ms: i32, frame_id: &str) -> Header {
    let stamp = Time { sec: time_ms / 1000, nanosec: (time_ms % 1000) as u32 * 1_000_000 };
    Header { stamp, frame_id: frame_id.to_owned() }
}

/// The bytes, red, green and blue, of a lit picture of 16 x 12 pixels; `press` counts are added in its middle.
pub fn rgb(press: u8) -> Vec<u8> {
    let pixel = |i: usize| {
        let (x, y) = (i % 16, i / 16);
        let is_pressed = (5..11).contains(&x) && (4..8).contains(&y);
        [60 + 4 * x as u8, 90, 100 + y as u8].map(|value| if is_pressed { value + press } else { value })
    };
    (0..16 * 12).flat_map(pixel).collect()
}

/// A picture of 16 x 12 pixels in rgb8; a time of 0 leaves its header empty.
pub fn image(topic: &'static str, time_ms: i32, press: u8) -> Sent {
    let (encoding, data) = ("rgb8".to_owned(), rgb(press));
    let header = header(time_ms, "gelsight");
    let image = Image { header, height: 12, width: 16, encoding, is_bigendian: 0, step: 48, data };
    (topic, Image::TYPE, time_ms as u64 * 1_000_000, to_cdr(&image))
}

/// A pose in the plane, mm and degrees, in metres.
pub fn in_plane([x_mm, y_mm, theta_deg]: [f64; 3]) -> Pose {
    let (sin, cos) = (theta_deg.to_radians() / 2.0).sin_cos();
    Pose { position: [x_mm / 1000.0, y_mm / 1000.0, 0.0], orientation: [0.0, 0.0, sin, cos] }
}

/// A pose in the plane, mm and degrees.
pub fn pose(topic: &'static str, time_ms: i32, frame_id: &str, at: [f64; 3]) -> Sent {
    let message = PoseStamped { header: header(time_ms, frame_id), pose: in_plane(at) };
    (topic, PoseStamped::TYPE, time_ms as u64 * 1_000_000, to_cdr(&message))
}
