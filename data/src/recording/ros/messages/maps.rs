//! Maps and clouds of points.

use crate::error::Result;
use crate::recording::ros::cdr::{Reader, Writer};
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

impl Message for OccupancyGrid {
    const TYPE: &str = "nav_msgs/msg/OccupancyGrid";
    const DEFINITION: &str = definitions::OCCUPANCY_GRID;

    fn read(cdr: &mut Reader) -> Result<Self> {
        Ok(Self {
            header: Header::read(cdr)?,
            map_load_time: Time::read(cdr)?,
            resolution: cdr.f32("resolution")?,
            width: cdr.u32("width")?,
            height: cdr.u32("height")?,
            origin: Pose::read(cdr)?,
            data: cdr.bytes("data")?.iter().map(|byte| byte.cast_signed()).collect(),
        })
    }

    fn write(&self, cdr: &mut Writer) {
        self.header.write(cdr);
        self.map_load_time.write(cdr);
        cdr.f32(self.resolution);
        cdr.u32(self.width);
        cdr.u32(self.height);
        self.origin.write(cdr);
        cdr.bytes(&self.data.iter().map(|value| value.cast_unsigned()).collect::<Vec<u8>>());
    }
}

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

    /// What one takes at least: an empty name, an offset, a type with its padding, a count.
    const LEAST_BYTES: usize = 4 + 4 + 4 + 4;

    fn read(cdr: &mut Reader) -> Result<Self> {
        Ok(Self {
            name: cdr.string("a field's name")?,
            offset: cdr.u32("offset")?,
            datatype: cdr.u8("datatype")?,
            count: cdr.u32("count")?,
        })
    }

    fn write(&self, cdr: &mut Writer) {
        cdr.string(&self.name);
        cdr.u32(self.offset);
        cdr.u8(self.datatype);
        cdr.u32(self.count);
    }
}

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

impl Message for PointCloud2 {
    const TYPE: &str = "sensor_msgs/msg/PointCloud2";
    const DEFINITION: &str = definitions::POINT_CLOUD2;

    fn read(cdr: &mut Reader) -> Result<Self> {
        let (header, height, width) = (Header::read(cdr)?, cdr.u32("height")?, cdr.u32("width")?);
        let count = cdr.count(PointField::LEAST_BYTES, "fields")?;
        Ok(Self {
            header,
            height,
            width,
            fields: (0..count).map(|_| PointField::read(cdr)).collect::<Result<_>>()?,
            is_bigendian: cdr.u8("is_bigendian")? != 0,
            point_step: cdr.u32("point_step")?,
            row_step: cdr.u32("row_step")?,
            data: cdr.bytes("data")?.to_vec(),
            is_dense: cdr.u8("is_dense")? != 0,
        })
    }

    fn write(&self, cdr: &mut Writer) {
        self.header.write(cdr);
        cdr.u32(self.height);
        cdr.u32(self.width);
        cdr.u32(self.fields.len() as u32);
        self.fields.iter().for_each(|field| field.write(cdr));
        cdr.u8(u8::from(self.is_bigendian));
        cdr.u32(self.point_step);
        cdr.u32(self.row_step);
        cdr.bytes(&self.data);
        cdr.u8(u8::from(self.is_dense));
    }
}
