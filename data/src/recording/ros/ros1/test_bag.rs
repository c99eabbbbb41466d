//! ROS 1 bags for tests, written byte by byte from the specification (<http://wiki.ros.org/Bags/Format/2.0>).

use std::io::Write;

use lz4_flex::frame::{BlockSize, FrameEncoder, FrameInfo};

use crate::recording::ros::messages::Pose;
use crate::recording::ros::ros1::records::{MAGIC, op};
use crate::recording::ros::test_bag::{Sent, in_plane, rgb};

/// The names of compressions.
pub const PACKINGS: [&str; 3] = ["none", "bz2", "lz4"];

/// How a test's bag ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum End {
    /// With an index.
    Closed,
    /// Behind a chunk.
    BehindChunk,
    /// In a chunk, before its lengths were written.
    InChunk,
}

/// Messages three a chunk.
pub fn bag(packing: &str, sent: &[Sent], end: End) -> Vec<u8> {
    let mut bytes = MAGIC.to_vec();
    bytes.extend(bag_header(0));
    let mut topics: Vec<(&str, &str)> = Vec::new();
    let n_chunks = sent.len().div_ceil(3);
    for (i, messages) in sent.chunks(3).enumerate() {
        let mut records = Vec::new();
        for (topic, type_name, time, data) in messages {
            let known = topics.iter().position(|(known, _)| known == topic);
            let number = known.unwrap_or(topics.len()) as u32;
            if known.is_none() {
                topics.push((topic, type_name));
                connection(&mut records, number, topic, type_name);
            }
            let time = [time / 1_000_000_000, time % 1_000_000_000].map(|part| (part as u32).to_le_bytes()).concat();
            record(&mut records, op::MESSAGE, &[("conn", &number.to_le_bytes()), ("time", &time)], data);
        }
        let packed = pack(packing, &records);
        if end == End::InChunk && i + 1 == n_chunks {
            chunk(&mut bytes, packing, 0, &[]);
            bytes.extend(packed);
        } else {
            chunk(&mut bytes, packing, records.len() as u32, &packed);
            record(&mut bytes, 4, &[("ver", &[1, 0, 0, 0])], &[0; 12]);
        }
    }
    if end == End::Closed {
        let header = bag_header(bytes.len() as u64);
        bytes[MAGIC.len()..MAGIC.len() + header.len()].copy_from_slice(&header);
        for (number, (topic, type_name)) in (0..).zip(&topics) {
            connection(&mut bytes, number, topic, type_name);
        }
        record(&mut bytes, 6, &[("ver", &[1, 0, 0, 0])], &[0; 8]);
    }
    bytes
}

/// The first record, 4096 bytes with spaces behind.
fn bag_header(index_at: u64) -> Vec<u8> {
    let fields: [(&str, &[u8]); 3] =
        [("index_pos", &index_at.to_le_bytes()), ("conn_count", &[0; 4]), ("chunk_count", &[0; 4])];
    let mut bytes = Vec::new();
    record(&mut bytes, op::BAG_HEADER, &fields, &[]);
    let n_spaces = 4096 - bytes.len();
    bytes.clear();
    record(&mut bytes, op::BAG_HEADER, &fields, &vec![b' '; n_spaces]);
    bytes
}

fn chunk(bytes: &mut Vec<u8>, packing: &str, size: u32, packed: &[u8]) {
    record(bytes, op::CHUNK, &[("compression", packing.as_bytes()), ("size", &size.to_le_bytes())], packed);
}

fn connection(bytes: &mut Vec<u8>, number: u32, topic: &str, type_name: &str) {
    let about = fields(&[("topic", topic.as_bytes()), ("type", type_name.as_bytes()), ("md5sum", b"*")]);
    record(bytes, op::CONNECTION, &[("conn", &number.to_le_bytes()), ("topic", topic.as_bytes())], &about);
}

fn record(bytes: &mut Vec<u8>, op: u8, header: &[(&str, &[u8])], data: &[u8]) {
    let header = [fields(header), fields(&[("op", &[op])])].concat();
    bytes.extend([sized(&header), sized(data)].concat());
}

fn fields(fields: &[(&str, &[u8])]) -> Vec<u8> {
    fields.iter().flat_map(|(name, value)| sized(&[name.as_bytes(), b"=", value].concat())).collect()
}

fn sized(bytes: &[u8]) -> Vec<u8> {
    [&(bytes.len() as u32).to_le_bytes(), bytes].concat()
}

fn pack(packing: &str, records: &[u8]) -> Vec<u8> {
    match packing {
        "bz2" => {
            let mut encoder = bzip2::write::BzEncoder::new(Vec::new(), bzip2::Compression::best());
            encoder.write_all(records).unwrap();
            encoder.finish().unwrap()
        }
        "lz4" => {
            // As roslz4 has it.
            let frame = FrameInfo::new().block_size(BlockSize::Max1MB).content_checksum(true);
            let mut encoder = FrameEncoder::with_frame_info(frame, Vec::new());
            encoder.write_all(records).unwrap();
            encoder.finish().unwrap()
        }
        _ => records.to_vec(),
    }
}

/// A number, a time and the name of a frame.
fn header(time_ms: i32, frame_id: &str) -> Vec<u8> {
    let numbers = [7, time_ms / 1000, time_ms % 1000 * 1_000_000].map(i32::to_le_bytes).concat();
    [numbers, sized(frame_id.as_bytes())].concat()
}

fn seven(Pose { position, orientation }: Pose) -> Vec<u8> {
    position.iter().chain(&orientation).flat_map(|value| value.to_le_bytes()).collect()
}

/// The picture of [`test_bag::image`](crate::recording::ros::test_bag::image).
pub fn image(topic: &'static str, time_ms: i32, press: u8) -> Sent {
    let [height, width, step] = [12, 16, 48].map(u32::to_le_bytes);
    let (encoding, data) = (sized(b"rgb8"), sized(&rgb(press)));
    let bytes = [&header(time_ms, "gelsight")[..], &height, &width, &encoding, &[0], &step, &data].concat();
    (topic, "sensor_msgs/Image", time_ms as u64 * 1_000_000, bytes)
}

/// A pose in the plane, mm and degrees.
pub fn pose(topic: &'static str, time_ms: i32, frame_id: &str, at: [f64; 3]) -> Sent {
    let bytes = [header(time_ms, frame_id), seven(in_plane(at))].concat();
    (topic, "geometry_msgs/PoseStamped", time_ms as u64 * 1_000_000, bytes)
}

/// One transform between two frames, in the plane.
pub fn transform(topic: &'static str, time_ms: i32, [parent, child]: [&str; 2], at: [f64; 3]) -> Sent {
    let one = 1_u32.to_le_bytes();
    let bytes = [&one[..], &header(time_ms, parent), &sized(child.as_bytes()), &seven(in_plane(at))].concat();
    (topic, "tf/tfMessage", time_ms as u64 * 1_000_000, bytes)
}
