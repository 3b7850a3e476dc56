//! scratch
use dem_beam::calibrate::{Bar, tension_test};
use dem_beam::statics::StaticProblem;
use dem_beam::{BeamMaterial, BondedParticles, Container, PackingSpec};
use nalgebra::Vector3;
/// Tip deflection and twist of a clamped bar under a force and a torque at its end.
fn stiffness(body: &BondedParticles, length: f64) -> Option<(f64, f64)> {
    let n = body.len();
    let mean = body.radii().iter().sum::<f64>() / n as f64;
    let at = |i: usize| body.positions()[i];
    let slab = |a: f64, b: f64| {
        (0..n)
            .filter(|&i| at(i).x >= a * length && at(i).x < b * length)
            .collect::<Vec<_>>()
    };
    let run = |load: &dyn Fn(&mut StaticProblem, &[usize])| {
        let mut p = StaticProblem::free(n);
        for i in 0..n {
            if at(i).x < body.radii()[i] + 0.05 * mean {
                p.held[i] = dem_beam::Held::ALL;
            }
        }
        let end: Vec<usize> = (0..n)
            .filter(|&i| length - at(i).x < body.radii()[i] + 0.05 * mean)
            .collect();
        load(&mut p, &end);
        p.solve(body, 1e-7, 100_000).ok()
    };
    // Pure bending moment about z and torque about x, as forces on the end layer.
    let moment = |axis: Vector3<f64>| {
        run(&|p: &mut StaticProblem, end: &[usize]| {
            let c: Vector3<f64> = end.iter().map(|&i| at(i)).sum::<Vector3<f64>>() / end.len() as f64;
            let mut j = 0.0;
            let rel = |i: usize| {
                let d = at(i) - c;
                Vector3::new(0.0, d.y, d.z)
            };
            for &i in end {
                j += axis.cross(&rel(i)).norm_squared();
            }
            for &i in end {
                p.loads[i].linear += axis.cross(&rel(i)) / j;
            }
        })
    };
    // rotation of sections about axis by least squares; slope along the middle half
    let slope = |u: &dem_beam::statics::Equilibrium, axis: Vector3<f64>| {
        let rot = |s: &[usize]| {
            let c: Vector3<f64> = s.iter().map(|&i| at(i)).sum::<Vector3<f64>>() / s.len() as f64;
            let m: Vector3<f64> =
                s.iter().map(|&i| u.displacements[i].linear).sum::<Vector3<f64>>() / s.len() as f64;
            let (mut a, mut b) = (0.0, 0.0);
            for &i in s {
                let d = at(i) - c;
                let d = Vector3::new(0.0, d.y, d.z);
                let w = axis.cross(&d);
                a += w.dot(&(u.displacements[i].linear - m));
                b += w.norm_squared();
            }
            a / b
        };
        let k = 12;
        let (mut sx, mut sy, mut sxx, mut sxy, mut m) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for j in 3..9 {
            let s = slab(j as f64 / k as f64, (j + 1) as f64 / k as f64);
            let x = (j as f64 + 0.5) / k as f64 * length;
            let y = rot(&s);
            sx += x;
            sy += y;
            sxx += x * x;
            sxy += x * y;
            m += 1.0;
        }
        (m * sxy - sx * sy) / (m * sxx - sx * sx)
    };
    let b = slope(&moment(Vector3::z())?, Vector3::z());
    let t = slope(&moment(Vector3::x())?, Vector3::x());
    Some((1.0 / b, 1.0 / t))
}
fn main() {
    let r = 1e-3;
    for quench in [false, true] {
        for across in [3.0, 4.0, 6.0, 8.0] {
            let d: f64 = 2.0 * r / across;
            let length = (10.0 * 2.0 * r).max(20.0 * d).min(20e-3);
            let n = (0.615 * 4.0 * r * r * length / (std::f64::consts::PI / 6.0 * d.powi(3) * 1.0625)).round()
                as usize;
            let c = Container::cuboid(Vector3::new(0.0, -r, -r), Vector3::new(length, r, r)).unwrap();
            let bar = Bar {
                start: 0.0,
                length,
                area: 4.0 * r * r,
            };
            let (mut e, mut nu, mut bend, mut tor, mut z, mut x, mut drop) =
                (vec![], vec![], vec![], vec![], vec![], vec![], 0);
            let mut err = String::new();
            for seed in 1..=if across > 7.0 { 2 } else { 4 } {
                let s = if quench {
                    PackingSpec::quench(c.clone(), n, seed)
                } else {
                    PackingSpec::new(c.clone(), n, seed)
                };
                let p = match s.build() {
                    Ok(p) => p,
                    Err(f) => {
                        err = f.to_string();
                        continue;
                    }
                };
                let b = p.bonded(BeamMaterial::SILICA, 2200.0).unwrap();
                let t = match tension_test(&b, &bar) {
                    Ok(t) => t,
                    Err(f) => {
                        err = f.to_string();
                        continue;
                    }
                };
                e.push(t.young / 1e9);
                nu.push(t.poisson);
                z.push(p.report.coordination_interior);
                x.push(p.report.across.unwrap());
                drop += p.report.dropped;
                if let Some((fb, ft)) = stiffness(&b, length) {
                    let i = 16.0 * r.powi(4) / 12.0;
                    let j = 0.140577 * 16.0 * r.powi(4);
                    bend.push(fb / (t.young_gauge * i));
                    tor.push(ft / (t.young_gauge / (2.0 * 1.174) * j));
                }
            }
            let m = |v: &[f64]| {
                let n = v.len().max(1) as f64;
                let a = v.iter().sum::<f64>() / n;
                let s = (v.iter().map(|x| (x - a).powi(2)).sum::<f64>() / (n - 1.0).max(1.0)).sqrt();
                format!("{a:.3}±{s:.3}")
            };
            println!(
                "q{quench} across {across} n {n}: real across {} E {} nu {} bend/EI {} tors/GJ(nu .174) {} z {} drop {drop} {err}",
                m(&x),
                m(&e),
                m(&nu),
                m(&bend),
                m(&tor),
                m(&z)
            );
        }
    }
}
