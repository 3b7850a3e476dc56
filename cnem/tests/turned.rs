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
    if domain.nodes().len() != body.points.len() && std::env::var("STRICT").is_ok() {
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

fn lattice(name: &str, n: usize, cell: &[[f64; 3]]) -> Body {
    let mut points = Vec::new();
    let m = n as f64;
    for c in 0..(n + 1).pow(3) {
        let o = [c % (n + 1), c / (n + 1) % (n + 1), c / (n + 1) / (n + 1)].map(|x| x as f64);
        for d in cell {
            let p = [0, 1, 2].map(|k| o[k] + d[k]);
            if p.iter().all(|x| *x <= m) {
                points.push(Point3::from(p));
            }
        }
    }
    Body::hull(name, points, m * m * m)
}

#[test]
fn wide() {
    let mut bodies = all();
    bodies.extend((4..24).map(|s| common::bodies::blocky(4, 24, s)));
    bodies.push(lattice(
        "fcc",
        2,
        &[[0.0; 3], [0.5, 0.5, 0.0], [0.5, 0.0, 0.5], [0.0, 0.5, 0.5]],
    ));
    bodies.push(lattice("bcc", 3, &[[0.0; 3], [0.5, 0.5, 0.5]]));
    bodies.push(lattice("grid 6", 6, &[[0.0; 3]]));
    bodies.push(common::bodies::rings("cylinder 4", 6, 4, |_| 2.0));
    bodies.push(common::bodies::rings("frustum", 5, 3, |z| 2.0 + 0.4 * z));
    let kinds: [(&str, &dyn Fn(u64) -> Map); 9] = [
        ("turn", &|s| Map::turn(s)),
        ("shear", &|s| Map::shear(s, 0.2)),
        ("tiny", &|s| Map::turn(s).scaled(1e-9)),
        ("huge", &|s| Map::turn(s).scaled(1e6)),
        ("far 1e2", &|s| Map::turn(s).moved([100.0, 20.0, -50.0])),
        ("far 1e4", &|s| Map::turn(s).moved([1e4, 2e4, -5e3])),
        ("far 1e6", &|s| Map::turn(s).moved([1e6, 2e5, -5e5])),
        ("sheared a lot", &|s| Map::shear(s, 0.6)),
        ("axes", &|s| Map {
            matrix: nalgebra::Rotation3::from_axis_angle(&nalgebra::Vector3::y_axis(), 0.1 * s as f64)
                .into_inner(),
            shift: nalgebra::Vector3::zeros(),
        }),
    ];
    for (kind, make) in kinds {
        let mut bad = Vec::new();
        let mut worst = 0.0_f64;
        for body in &bodies {
            for seed in 100..108 {
                match defect(&body.mapped(&make(seed))) {
                    Ok(d) if d <= 1e-10 => worst = worst.max(d),
                    Ok(d) => bad.push(format!("{} {seed}: {d:.1e}", body.name)),
                    Err(e) => bad.push(format!("{} {seed}: {e}", body.name)),
                }
            }
        }
        println!(
            "{kind}: worst good {worst:.1e}, bad {} {:?}",
            bad.len(),
            &bad[..bad.len().min(8)]
        );
    }
    for digits in [4, 5, 6, 7, 8, 9, 10, 11, 12, 13, 14, 15] {
        let mut bad = Vec::new();
        let mut worst = 0.0_f64;
        for body in &bodies {
            for seed in 200..203 {
                let mut b = body.mapped(&Map::turn(seed));
                for p in &mut b.points {
                    for x in p.iter_mut() {
                        *x = format!("{x:.digits$e}").parse().unwrap();
                    }
                }
                if let Ok(d) = Domain::new(&b.points, &b.surface) {
                    b.volume = d.volume();
                }
                match defect(&b) {
                    Ok(d) if d <= 1e-10 => worst = worst.max(d),
                    Ok(d) => bad.push(format!("{} {seed}: {d:.1e}", body.name)),
                    Err(e) => bad.push(format!("{} {seed}: {e}", body.name)),
                }
            }
        }
        println!(
            "{digits} digits: worst good {worst:.1e}, bad {} {:?}",
            bad.len(),
            &bad[..bad.len().min(8)]
        );
    }
}

#[test]
fn grey() {
    for digits in [8, 10, 12] {
        let mut b = common::bodies::grid_hull([2, 2, 2]).mapped(&Map::turn(200));
        for p in &mut b.points {
            for x in p.iter_mut() {
                *x = format!("{x:.digits$e}").parse().unwrap();
            }
        }
        let dom = Domain::new(&b.points, &b.surface).unwrap();
        b.volume = dom.volume();
        println!(
            "digits {digits} defect {:?} vol {:e}",
            defect(&b),
            dom.volume() - 8.0
        );
        let (mut n, mut least) = (0, 1.0_f64);
        for t in dom.elements() {
            n += 1;
            least = least.min(cnem::delaunay::volume(t.map(|v| &dom.nodes()[v])).abs());
        }
        println!(
            "elements {n} least {least:e} hull {}",
            dom.delaunay().hull().count()
        );
        let cells = match dom.voronoi() {
            Ok(c) => c,
            Err(e) => {
                println!("{e}");
                continue;
            }
        };
        println!("{:?} gaps {:?}", cells.closure(&dom), cells.gaps());
        let mut sc = cnem::natural::Scratch::new();
        for i in 0..cells.len() {
            for f in cells.facets(i) {
                let before = sc.counters();
                match dom.shape(cnem::natural::Kind::Laplace, &f.centroid, &mut sc) {
                    Err(e) => println!("{i} {f:?} {e}"),
                    Ok(row) => {
                        let m: nalgebra::Vector3<f64> = row
                            .nodes
                            .iter()
                            .zip(&row.values)
                            .map(|(&v, w)| (dom.nodes()[v] - f.centroid) * *w)
                            .sum();
                        let row = row.clone();
                        if m.norm() > 1e-11 && before.linear < 1000 {
                            println!(
                                "{i} {:?} {:e} residual {:e} {row:?} {:?} {before:?}",
                                f.side,
                                f.area.norm(),
                                m.norm(),
                                sc.counters()
                            );
                        }
                    }
                }
            }
        }
        for i in 0..cells.len() {
            let sum: nalgebra::Vector3<f64> = cells.facets(i).iter().map(|f| f.area).sum();
            let total: f64 = cells.facets(i).iter().map(|f| f.area.norm()).sum();
            if sum.norm() > 1e-10 * total {
                println!("  {i} {:.2e} vol {}", sum.norm() / total, cells.volumes()[i]);
            }
        }
    }
}

#[test]
fn surface_points() {
    for (name, make) in [
        ("turn", (|s| Map::turn(s)) as fn(u64) -> Map),
        ("shear", |s| Map::shear(s, 0.2)),
        ("far", |s| Map::turn(s).moved([100.0, 20.0, -50.0])),
    ] {
        let (mut asked, mut refused, mut wrong) = (0, 0, 0);
        let mut worst = 0.0_f64;
        for body in all() {
            for seed in 300..304 {
                let b = body.mapped(&make(seed));
                let dom = Domain::new(&b.points, &b.surface).unwrap();
                let mut next = common::noise(seed);
                let mut sc = cnem::natural::Scratch::new();
                let faces: Vec<_> = if b.surface.boundary_faces().is_empty() {
                    dom.constrained_faces().map(|f| f.0).collect()
                } else {
                    b.surface.boundary_faces().to_vec()
                };
                for f in faces {
                    for _ in 0..20 {
                        let [mut u, mut v] = [0.5 + 0.5 * next(), 0.5 + 0.5 * next()];
                        if u + v > 1.0 {
                            (u, v) = (1.0 - u, 1.0 - v);
                        }
                        let [p, q, r] = f.map(|k| dom.nodes()[k]);
                        let x = p + (q - p) * u + (r - p) * v;
                        asked += 1;
                        match dom.shape(cnem::natural::Kind::Laplace, &x, &mut sc) {
                            Err(_) => refused += 1,
                            Ok(row) => {
                                let m: nalgebra::Vector3<f64> = row
                                    .nodes
                                    .iter()
                                    .zip(&row.values)
                                    .map(|(&v, w)| (dom.nodes()[v] - x) * *w)
                                    .sum();
                                worst = worst.max(m.norm());
                                if m.norm() > 1e-11 {
                                    wrong += 1;
                                }
                            }
                        }
                    }
                }
            }
        }
        println!("{name}: {asked} asked {refused} refused {wrong} wrong, worst {worst:e}");
    }
}
