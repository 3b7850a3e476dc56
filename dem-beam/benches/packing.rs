//! Time per sphere of packings in a box, a fine ball (as from STL), a meshed block, and a part of a body, on
//! one and on two threads.
//!
//! `cargo bench -p dem-beam --bench packing [spheres]`; default 4 000.
#![allow(clippy::print_stdout, reason = "a bench talks to a person")]

use dem_beam::packing::Around;
use dem_beam::packing::size::mean_diameter;
use dem_beam::{Container, PackingSpec, Surface};
use nalgebra::Vector3;
use std::time::Instant;

type Triangle = [Vector3<f64>; 3];

/// Side of a box of `cells` along each axis, two triangles per cell; the side at the low or the high end of
/// an axis.
fn side([low, high]: [Vector3<f64>; 2], cells: [usize; 3], axis: usize, is_high: bool) -> Vec<Triangle> {
    let (b, c) = ((axis + 1) % 3, (axis + 2) % 3);
    let corner = |i: usize, j: usize| {
        let mut x = if is_high { high } else { low };
        x[b] = low[b] + (high[b] - low[b]) * i as f64 / cells[b] as f64;
        x[c] = low[c] + (high[c] - low[c]) * j as f64 / cells[c] as f64;
        x
    };
    let cell = |k: usize| {
        let (i, j) = (k / cells[c], k % cells[c]);
        let [p, q, r, s] = [
            corner(i, j),
            corner(i + 1, j),
            corner(i + 1, j + 1),
            corner(i, j + 1),
        ];
        match is_high {
            true => [[p, q, r], [p, r, s]],
            false => [[p, r, q], [p, s, r]],
        }
    };
    (0..cells[b] * cells[c]).flat_map(cell).collect()
}

fn block(corners: [Vector3<f64>; 2], cells: [usize; 3]) -> Vec<Triangle> {
    let sides = (0..6).map(|k| side(corners, cells, k / 2, k % 2 == 1));
    sides.flatten().collect()
}

/// Surface of triangles whose corners agree up to round-off.
fn surface(triangles: &[Triangle]) -> Result<Surface, dem_beam::Error> {
    let mut numbers = std::collections::BTreeMap::new();
    let mut vertices = Vec::new();
    let mut number = |x: &Vector3<f64>| {
        let key = [x.x, x.y, x.z].map(|c| (c * 1e9).round() as i64);
        *numbers.entry(key).or_insert_with(|| {
            vertices.push(*x);
            vertices.len() as u32 - 1
        })
    };
    let triangles = triangles.iter().map(|t| t.each_ref().map(&mut number)).collect();
    Surface::oriented(vertices, triangles)
}

fn shapes(count: usize) -> Result<Vec<(&'static str, Container)>, dem_beam::Error> {
    let (zero, one) = (Vector3::zeros(), Vector3::repeat(1e-3));
    let ball = block([-one, one], [30; 3]);
    let ball: Vec<_> = ball.iter().map(|t| t.map(|x| x.normalize() * 1e-3)).collect();
    // A third of a bar, with the margin that is packed around it.
    let bar = block([zero, Vector3::new(3e-3, 1e-3, 1e-3)], [24, 8, 8]);
    let margin = 2.5 * mean_diameter(1e-9, 0.7 * count as f64);
    let border = side([zero, one], [8; 3], 0, true);
    let part = surface(&block([zero, one], [8; 3]))?;
    Ok(vec![
        ("box", Container::cuboid(zero, one)?),
        ("ball, 10 800 triangles", Container::Surface(surface(&ball)?)),
        (
            "block, 1 728 triangles",
            Container::Surface(surface(&block([zero, one], [12; 3]))?),
        ),
        (
            "part of a bar",
            Container::Around(Box::new(Around::new(part, surface(&bar)?, &border, margin)?)),
        ),
    ])
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let count = std::env::args().find_map(|a| a.parse().ok()).unwrap_or(4000);
    println!("{count} spheres, ms per sphere   1 thread  2 threads  steps");
    for (name, container) in shapes(count)? {
        let spec = PackingSpec::new(container, count, 1);
        let build = |threads| -> Result<_, Box<dyn std::error::Error>> {
            let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build()?;
            let start = Instant::now();
            let packing = pool.install(|| spec.build())?;
            Ok((packing, 1e3 * start.elapsed().as_secs_f64() / count as f64))
        };
        let (one, two) = (build(1)?, build(2)?);
        assert!(one.0 == two.0, "the bits depend on the number of threads");
        println!("{name:28} {:10.3} {:10.3} {:6}", one.1, two.1, one.0.report.steps);
    }
    Ok(())
}
