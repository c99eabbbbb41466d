//! Meshes: the surface of an STL as seen from above.

use std::collections::HashMap;
use std::io::BufReader;
use std::path::Path;

use super::HeightMap;
use crate::error::{Error, Result};
use crate::file::bounded_file::{self, Kind};

/// How far below the top the map is where there is no mesh, mm: deeper than any press.
const OPEN_MM: f32 = 10.0;

/// The longest side of a mesh, mm.
const MAX_SIDE_MM: f32 = 500.0;

/// The most pixels of a map.
const MAX_PIXELS: usize = 1 << 24;

/// The top surface of a closed mesh in mm, seen from +z with y up: a height map centred on the mesh's box, of
/// pixels of about `cell_mm`. Where there is no mesh, at 10 mm below the top or deeper, it is open.
///
/// Refuses a mesh with holes (an edge that is not shared by exactly two triangles), of zero height, or larger
/// than 500 mm.
pub fn height_map(path: &Path, cell_mm: f64) -> Result<HeightMap> {
    let refuse = |expected: &str, got: String| Error::invalid(path.display().to_string(), expected, got);
    let mut reader = BufReader::new(bounded_file::open_kind(path, Kind::MESH)?);
    let mesh = stl_io::read_stl(&mut reader).map_err(|e| refuse("an STL mesh", e.to_string()))?;
    // -0 and 0 are one place, though not the same bits.
    let vertices: Vec<[f32; 3]> = mesh.vertices.iter().map(|vertex| vertex.0.map(|v| v + 0.0)).collect();
    let welded = welded(&vertices);
    let faces: Vec<[usize; 3]> = mesh.faces.iter().map(|face| face.vertices.map(|i| welded[i])).collect();
    if faces.is_empty() || vertices.iter().flatten().any(|v| !v.is_finite()) {
        return Err(refuse("triangles of finite numbers", format!("{} triangles", faces.len())));
    }
    if let Some((count, at)) = open_edge(&faces) {
        let got = format!("an edge of {count} at {:?} mm", vertices[at]);
        return Err(refuse("a mesh without holes: each edge shared by two triangles", got));
    }
    let low = [0, 1, 2].map(|axis| vertices.iter().map(|v| v[axis]).fold(f32::INFINITY, f32::min));
    let high = [0, 1, 2].map(|axis| vertices.iter().map(|v| v[axis]).fold(f32::NEG_INFINITY, f32::max));
    let size = [0, 1, 2].map(|axis| high[axis] - low[axis]);
    if !(size.iter().all(|mm| *mm > 0.0) && size[0].max(size[1]) <= MAX_SIDE_MM) {
        let got = format!("{} x {} x {} mm", size[0], size[1], size[2]);
        return Err(refuse(&format!("a mesh with a height, no wider than {MAX_SIDE_MM} mm"), got));
    }
    // Whole pixels over the mesh's box, so that none hangs over its edge.
    let size_px = [0, 1].map(|axis| ((f64::from(size[axis]) / cell_mm) as usize).max(2));
    if cell_mm.is_nan() || cell_mm <= 0.0 || size_px[0].saturating_mul(size_px[1]) > MAX_PIXELS {
        return Err(refuse(&format!("a cell that gives at most {MAX_PIXELS} pixels"), format!("{cell_mm} mm")));
    }
    let mm_per_px = [0, 1].map(|axis| f64::from(size[axis]) / size_px[axis] as f64);
    let mut heights = vec![low[2].min(high[2] - OPEN_MM); size_px[0] * size_px[1]];
    // To pixels: the map's y runs down, the mesh's up.
    let pixel = |[x, y, z]: [f32; 3]| {
        [f64::from(x - low[0]) / mm_per_px[0] - 0.5, f64::from(high[1] - y) / mm_per_px[1] - 0.5, f64::from(z)]
    };
    for face in &faces {
        raise(&mut heights, size_px, face.map(|i| pixel(vertices[i])));
    }
    HeightMap::new(size_px, mm_per_px, &heights)
}

/// For each vertex the first one at the same place.
fn welded(vertices: &[[f32; 3]]) -> Vec<usize> {
    let mut seen = HashMap::new();
    vertices.iter().enumerate().map(|(i, vertex)| *seen.entry(vertex.map(f32::to_bits)).or_insert(i)).collect()
}

/// How many triangles share the first edge that is not shared by two, and a vertex of it.
fn open_edge(faces: &[[usize; 3]]) -> Option<(usize, usize)> {
    let edges = |face: &[usize; 3]| [0, 1, 2].map(|i| (face[i].min(face[(i + 1) % 3]), face[i].max(face[(i + 1) % 3])));
    // Slivers with two corners in one place bound nothing.
    let is_sliver = |[a, b, c]: &[usize; 3]| a == b || b == c || c == a;
    let mut edges: Vec<(usize, usize)> = faces.iter().filter(|face| !is_sliver(face)).flat_map(edges).collect();
    edges.sort_unstable();
    edges.chunk_by(|a, b| a == b).find(|same| same.len() != 2).map(|same| (same.len(), same[0].0))
}

/// Raises the pixels whose centres a triangle covers, seen from above, to its plane.
fn raise(heights: &mut [f32], [n_columns, n_rows]: [usize; 2], [a, b, c]: [[f64; 3]; 3]) {
    let doubled_area = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
    if doubled_area == 0.0 {
        return;
    }
    // A pixel on the common edge of two triangles belongs to both.
    let least = -1e-9 * doubled_area.abs().max(1.0);
    let range = |axis: usize, n: usize| {
        let low = a[axis].min(b[axis]).min(c[axis]).ceil().max(0.0) as usize;
        let high = (a[axis].max(b[axis]).max(c[axis]).floor() + 1.0).max(0.0) as usize;
        low..high.min(n)
    };
    for row in range(1, n_rows) {
        for column in range(0, n_columns) {
            let (x, y) = (column as f64, row as f64);
            let part =
                |p: [f64; 3], q: [f64; 3]| ((p[0] - x) * (q[1] - y) - (p[1] - y) * (q[0] - x)) * doubled_area.signum();
            let parts = [part(b, c), part(c, a), part(a, b)];
            if parts.iter().all(|part| *part >= least) {
                let height = (parts[0] * a[2] + parts[1] * b[2] + parts[2] * c[2]) / doubled_area.abs();
                let pixel = &mut heights[row * n_columns + column];
                *pixel = pixel.max(height as f32);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// An ASCII STL of triangles.
    fn write(path: &Path, triangles: &[[[f32; 3]; 3]]) {
        let corner = |[x, y, z]: [f32; 3]| format!("vertex {x} {y} {z}\n");
        let facet = |triangle: &[[f32; 3]; 3]| {
            format!("facet normal 0 0 0\nouter loop\n{}endloop\nendfacet\n", triangle.map(corner).concat())
        };
        let facets: String = triangles.iter().map(facet).collect();
        std::fs::write(path, format!("solid part\n{facets}endsolid part\n")).unwrap();
    }

    /// A four-sided pyramid: a base of 8 x 4 mm, its tip 2 mm above (1, 0.5).
    fn pyramid(height: f32) -> Vec<[[f32; 3]; 3]> {
        let base = [[-4.0, -2.0, -0.0], [4.0, -2.0, 0.0], [4.0, 2.0, 0.0], [-4.0, 2.0, 0.0]];
        let tip = [1.0, 0.5, height];
        let mut triangles: Vec<_> = (0..4).map(|i| [base[i], base[(i + 1) % 4], tip]).collect();
        // One corner is written with another zero, as programs do.
        let first = [-4.0, -2.0, 0.0];
        triangles.extend([[first, base[2], base[1]], [first, base[3], base[2]]]);
        triangles
    }

    #[test]
    fn a_pyramid_is_seen_from_above_with_y_up() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("pyramid.stl");
        write(&path, &pyramid(2.0));
        let map = height_map(&path, 0.05).unwrap();
        assert_eq!((map.size_px(), map.bounds()), ([160, 80], [-4.0, -2.0, 4.0, 2.0]));
        // On the map y runs down. The tip is within a pixel of a centre: the slope there is 4/3 at most.
        let drop = |x, y| f64::from(map.drop_at([x, y]).unwrap());
        assert!(drop(1.0, -0.5) < 0.06);
        // Halfway from the tip to each corner and to the middle of the lower side it is half as high.
        for [x, y] in [[2.5, 0.75], [-1.5, -1.25], [0.5, 0.75]] {
            assert!((drop(x, y) - 1.0).abs() < 0.06, "{x} {y}: {}", drop(x, y));
        }
    }

    #[test]
    fn every_triangle_of_a_flat_top_covers_its_pixels() {
        // A disc whose top is cut into a fan: no pixel may fall between two triangles.
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("fan.stl");
        let n = 12;
        let rim = |i: usize, z: f32| {
            let angle = std::f32::consts::TAU * (i % n) as f32 / n as f32;
            [3.0 * angle.cos(), 3.0 * angle.sin(), z]
        };
        let wall =
            |i: usize| [[rim(i, 0.0), rim(i + 1, 0.0), rim(i + 1, 1.0)], [rim(i, 0.0), rim(i + 1, 1.0), rim(i, 1.0)]];
        let mut triangles: Vec<_> = (0..n).flat_map(wall).collect();
        triangles.extend((0..n).map(|i| [[0.0, 0.0, 1.0], rim(i, 1.0), rim(i + 1, 1.0)]));
        triangles.extend((0..n).map(|i| [[0.0, 0.0, 0.0], rim(i + 1, 0.0), rim(i, 0.0)]));
        write(&path, &triangles);
        let map = height_map(&path, 0.1).unwrap();
        let covered = map.drops_mm().iter().filter(|drop| **drop == 0.0).count();
        // A regular polygon of twelve sides: 3 r^2.
        assert!((covered as f64 * map.mm_per_px()[0] * map.mm_per_px()[1] - 27.0).abs() < 0.5);
        assert!(map.drops_mm().iter().all(|drop| *drop == 0.0 || *drop == OPEN_MM));
    }

    #[test]
    fn a_broken_mesh_is_refused_with_its_file() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("part.stl");
        for (triangles, reason) in [(&pyramid(2.0)[1..], "holes"), (&pyramid(0.0), "height"), (&[], "triangles")] {
            write(&path, triangles);
            let error = height_map(&path, 0.1).unwrap_err().to_string();
            assert!(error.contains("part.stl") && error.contains(reason) && !error.contains('\n'), "{error}");
        }
        std::fs::write(&path, "no mesh").unwrap();
        assert!(height_map(&path, 0.1).unwrap_err().to_string().contains("part.stl"));
    }
}
