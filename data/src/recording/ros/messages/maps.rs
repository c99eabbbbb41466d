//! Maps and clouds of points.

use crate::error::Result;
use crate::recording::ros::cdr::{Field, Reader, Writer, fields};
use crate::recording::ros::definitions;
use crate::recording::ros::messages::{Header, Message, Pose, Time};

/// `nav_msgs/msg/OccupancyGrid`: a map of square cells.
#[derive(Clone, Debug, PartialEq)]
pub struct OccupancyGrid {
    /// When, and the frame in which the origin is given.
    pub header: Header,
    /// When the map was made.
    pub map_load_time: Time,
    /// Side of a cell, metres.
    pub resolution: f32,
    /// Cells along x.
    pub width: u32,
    /// Cells along y.
    pub height: u32,
    /// Pose of the corner of the first cell.
    pub origin: Pose,
    /// `[height, width]`: 0..=100, or -1 for unknown.
    pub data: Vec<i8>,
}

fields! { OccupancyGrid { header, map_load_time, resolution, width, height, origin, data } in "nav_msgs/msg/OccupancyGrid", OCCUPANCY_GRID }

/// `sensor_msgs/msg/PointField`: where a number is in a point.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PointField {
    /// Its name.
    pub name: String,
    /// Bytes from the start of the point.
    pub offset: u32,
    /// Its type: 7 is a number of 32 bits with a fraction.
    pub datatype: u8,
    /// How many follow each other.
    pub count: u32,
}

impl PointField {
    /// The [`PointField::datatype`] of `f32`.
    pub const FLOAT32: u8 = 7;
}

fields! { PointField { name, offset, datatype, count } }

/// `sensor_msgs/msg/PointCloud2`.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct PointCloud2 {
    /// When, and the frame in which the points are given.
    pub header: Header,
    /// 1 where the points have no order.
    pub height: u32,
    /// Points in a row.
    pub width: u32,
    /// What a point holds.
    pub fields: Vec<PointField>,
    /// Whether numbers are big endian.
    pub is_bigendian: bool,
    /// Bytes of a point.
    pub point_step: u32,
    /// Bytes of a row.
    pub row_step: u32,
    /// `row_step * height` bytes.
    pub data: Vec<u8>,
    /// Whether no point is missing.
    pub is_dense: bool,
}

impl PointCloud2 {
    /// Points in any order, each of these numbers of 32 bits.
    pub fn of_floats<const N: usize>(header: Header, names: [&str; N], points: &[[f32; N]]) -> Self {
        let field = |(i, name): (usize, &str)| PointField {
            name: name.to_owned(),
            offset: 4 * i as u32,
            datatype: PointField::FLOAT32,
            count: 1,
        };
        Self {
            header,
            height: 1,
            width: points.len() as u32,
            fields: names.into_iter().enumerate().map(field).collect(),
            is_bigendian: false,
            point_step: 4 * N as u32,
            row_step: 4 * (N * points.len()) as u32,
            data: points.iter().flatten().flat_map(|value| value.to_le_bytes()).collect(),
            is_dense: true,
        }
    }
}

fields! { PointCloud2 { header, height, width, fields, is_bigendian, point_step, row_step, data, is_dense } in "sensor_msgs/msg/PointCloud2", POINT_CLOUD2 }
