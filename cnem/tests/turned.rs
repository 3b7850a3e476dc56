//! GOAL: a body is the same body turned, sheared, far away, tiny or huge.
#![allow(clippy::unwrap_used, reason = "a test fails by panicking")]

mod common;

use arlequin_core::model::{LinearModel, Model};
use cnem::domain::Domain;
use cnem::{CnemModel, Elastic, Options};
use common::bodies::{Body, Map, all};
use nalgebra::{Matrix3, Point3};

/// Largest relative error of the energies of the six linear fields; the message where there is no model.
fn defect(body: &Body) -> Result<f64, String> {
    let domain = Domain::new(&body.points, &body.surface).map_err(|e| e.to_string())?;
    if domain.nodes().len() != body.points.len() {
        return Err(format!(
            "{} nodes for {}",
            domain.nodes().len(),
            body.points.len()
        ));
    }
    let material = Elastic::new(1.0, 0.25, 1.0).unwrap();
    let model = CnemModel::new("body", domain, material, Options::default()).map_err(|e| e.to_string())?;
    let nodes = model.nodes();
    let centre = nodes.iter().map(|p| p.coords).sum::<nalgebra::Vector3<f64>>() / nodes.len() as f64;
    let mut worst = 0.0_f64;
    for k in 0..6 {
        let mut g = Matrix3::zeros();
        g[(k % 3, (k + k / 3) % 3)] = 1.0;
        let strain = (g + g.transpose()) * 0.5;
        let stress = Matrix3::identity() * (0.4 * strain.trace()) + strain * 0.8;
        let exact = 0.5 * strain.dot(&stress) * body.volume;
        let u: Vec<f64> = nodes
            .iter()
            .flat_map(|p: &Point3<f64>| {
                let u = g * (p.coords - centre);
                [u.x, u.y, u.z]
            })
            .collect();
        worst = worst.max((model.internal_energy(&u) / exact - 1.0).abs());
        if worst.is_nan() {
            return Ok(f64::NAN);
        }
    }
    if model.stiffness().data().iter().any(|x| !x.is_finite()) {
        return Ok(f64::INFINITY);
    }
    Ok(worst)
}

#[test]
fn survey() {
    for body in all() {
        let mut bad = Vec::new();
        let mut worst = 0.0_f64;
        for seed in 1..=40 {
            let map = if seed > 20 {
                Map::shear(seed, 0.4)
            } else {
                Map::turn(seed)
            };
            match defect(&body.mapped(&map)) {
                Ok(d) if d <= 1e-10 => worst = worst.max(d),
                Ok(d) => bad.push(format!("{seed}: {d:.1e}")),
                Err(e) => bad.push(format!("{seed}: {e}")),
            }
        }
        println!(
            "{:25} {:?} unturned, worst good {worst:.1e}, bad {} {:?}",
            body.name,
            defect(&body),
            bad.len(),
            &bad[..bad.len().min(5)]
        );
    }
}

fn sphere(square: i32) -> Vec<Point3<f64>> {
    let r = f64::from(square).sqrt() as i32 + 1;
    let mut out = Vec::new();
    for x in -r..=r {
        for y in -r..=r {
            for z in -r..=r {
                if x * x + y * y + z * z == square {
                    out.push(Point3::new(f64::from(x), f64::from(y), f64::from(z)));
                }
            }
        }
    }
    out
}

#[test]
fn counts() {
    let mut best = std::collections::BTreeMap::new();
    for s in 1..4000 {
        let n = sphere_count(s);
        if n >= 400 {
            best.entry(n).or_insert(s);
        }
    }
    println!("{best:?}");
}
fn sphere_count(square: i32) -> usize {
    let r = f64::from(square).sqrt() as i32 + 1;
    let mut n = 0;
    for x in -r..=r {
        for y in -r..=r {
            let z2 = square - x * x - y * y;
            if z2 < 0 {
                continue;
            }
            let z = f64::from(z2).sqrt().round() as i32;
            if z * z == z2 {
                n += if z == 0 { 1 } else { 2 };
            }
        }
    }
    n
}
#[test]
fn spheres() {
    for s in [9, 1105] {
        let points = sphere(s);
        let t = std::time::Instant::now();
        let d = cnem::delaunay::Delaunay::new(&points).unwrap();
        println!(
            "{} points delaunay {:?} tets {}",
            points.len(),
            t.elapsed(),
            d.tetrahedron_count()
        );
        let t = std::time::Instant::now();
        let dom = Domain::new(&points, &cnem::constraint::Surface::convex_hull()).unwrap();
        println!("domain {:?}", t.elapsed());
        let t = std::time::Instant::now();
        let volume = dom.volume();
        let c = dom.voronoi().map(|c| c.closure(&dom));
        println!("cells {:?} {c:?}", t.elapsed());
        let t = std::time::Instant::now();
        let body = Body::hull("sphere", points.clone(), volume);
        println!("{:?}", defect(&body));
        println!("{:?}", defect(&body.mapped(&Map::turn(3))));
        println!("model {:?}", t.elapsed());
    }
}

#[test]
fn which() {
    for body in all()
        .iter()
        .filter(|b| ["cylinder", "cone"].contains(&b.name.as_str()))
    {
        for seed in 1..=40 {
            let map = if seed > 20 {
                Map::shear(seed, 0.4)
            } else {
                Map::turn(seed)
            };
            let b = body.mapped(&map);
            let dom = Domain::new(&b.points, &b.surface).unwrap();
            let cells = match dom.voronoi() {
                Ok(c) => c,
                Err(e) => {
                    println!("{} {seed} {e}", b.name);
                    continue;
                }
            };
            let c = cells.closure(&dom);
            if c.area > 1e-12 || c.volume > 1e-12 {
                println!(
                    "{} {seed} {c:?} {:?} vol {:e} gaps {:?}",
                    b.name,
                    dom.volume() / b.volume - 1.0,
                    0,
                    cells.gaps()
                );
                for i in 0..cells.len() {
                    let sum: nalgebra::Vector3<f64> = cells.facets(i).iter().map(|f| f.area).sum();
                    let total: f64 = cells.facets(i).iter().map(|f| f.area.norm()).sum();
                    if sum.norm() > 1e-10 * total {
                        println!(
                            "  {i} {:?} {:.2e} {:?}",
                            body.points[i],
                            sum.norm() / total,
                            map.matrix.try_inverse().unwrap() * sum
                        );
                        for f in cells.facets(i) {
                            println!(
                                "     {:?} {:?} {:?}",
                                f.side,
                                map.matrix.try_inverse().unwrap() * f.centroid.coords,
                                f.area.norm()
                            );
                        }
                    }
                }
            }
            for t in dom.elements() {
                let p = t.map(|v| &dom.nodes()[v]);
                let v = cnem::delaunay::volume(p);
                if v < 1e-9 {
                    println!("{} {seed} thin {t:?} {v:e}", b.name);
                }
            }
        }
    }
}
