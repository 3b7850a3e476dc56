//! The energy that a crack releases: a plate with an edge crack against the handbook, against the change of
//! its own energy, and between domains.
#![allow(clippy::print_stdout, reason = "a test shows what it measured")]

use arlequin_scene::{Results, Scene, Silent};
use std::f64::consts::PI;
use std::fmt::Write as _;
use std::path::PathBuf;

/// Width of the plate along x \[m\]; its height is three times as large.
const WIDTH: f64 = 0.1;
/// Thickness \[m\].
const THICK: f64 = 0.02;
const YOUNG: f64 = 70e9;
const POISSON: f64 = 0.3;
/// Pull on both ends \[Pa\].
const PULL: f64 = 1e6;

/// A plate with a slit at y = 0 from x = 0 to its front, as a Gmsh file.
#[derive(Clone, Copy)]
struct Plate {
    /// Length of the crack \[m\].
    crack: f64,
    /// Size of the elements around the front \[m\].
    fine: f64,
    /// Elements through the thickness.
    layers: usize,
    tetrahedra: bool,
}

/// Returns coordinates from zero to an end with steps that grow by a tenth each.
fn growing(first: f64, end: f64) -> Vec<f64> {
    let mut out = vec![0.0];
    let (mut x, mut h) = (0.0, first);
    while x + 1.5 * h < end {
        x += h;
        out.push(x);
        // The steps stay even around the front, where the domains lie.
        if x > 0.4 * WIDTH * 0.4 {
            h *= 1.2;
        }
    }
    out.push(end);
    out
}

impl Plate {
    fn lines(&self) -> [Vec<f64>; 3] {
        let behind = growing(self.fine, self.crack);
        let ahead = growing(self.fine, WIDTH - self.crack);
        let upwards = growing(self.fine, 1.5 * WIDTH);
        let mirrored = |v: &[f64], about: f64| v.iter().rev().map(|x| about - x).collect::<Vec<f64>>();
        let mut x = mirrored(&behind, self.crack);
        x.extend(ahead[1..].iter().map(|x| self.crack + x));
        let mut y = mirrored(&upwards, 0.0);
        y.extend(&upwards[1..]);
        let z = (0..=self.layers).map(|k| THICK * k as f64 / self.layers as f64);
        [x, y, z.collect()]
    }

    /// Writes the mesh in units of `scale` metres and returns its path.
    fn write(&self, name: &str, scale: f64) -> PathBuf {
        let [x, y, z] = self.lines();
        let [nx, ny, nz] = [x.len(), y.len(), z.len()];
        let node_index = |i: usize, j: usize, k: usize| (i * ny + j) * nz + k;
        let middle = ny / 2;
        let front = x
            .iter()
            .position(|x| (x - self.crack).abs() < 1e-12)
            .expect("a line at the front");
        let upper = |i: usize, k: usize| nx * ny * nz + i * nz + k;
        let mut text = String::from("$MeshFormat\n2.2 0 8\n$EndMeshFormat\n$Nodes\n");
        let _ = writeln!(text, "{}", nx * ny * nz + front * nz);
        let mut node = |n: usize, p: [f64; 3]| {
            let [a, b, c] = p.map(|c| c / scale);
            let _ = writeln!(text, "{} {a:e} {b:e} {c:e}", n + 1);
        };
        for (i, x) in x.iter().enumerate() {
            for (j, y) in y.iter().enumerate() {
                (0..nz).for_each(|k| node(node_index(i, j, k), [*x, *y, z[k]]));
            }
        }
        for (i, x) in x[..front].iter().enumerate() {
            (0..nz).for_each(|k| node(upper(i, k), [*x, 0.0, z[k]]));
        }
        let mut elements = Vec::new();
        for (i, j, k) in
            (0..nx - 1).flat_map(|i| (0..ny - 1).flat_map(move |j| (0..nz - 1).map(move |k| (i, j, k))))
        {
            let corner = |a: usize, b: usize, c: usize| {
                let lip = j == middle && b == 0 && i + a < front;
                1 + if lip {
                    upper(i + a, k + c)
                } else {
                    node_index(i + a, j + b, k + c)
                }
            };
            if self.tetrahedra {
                for path in [[0, 1, 2], [1, 2, 0], [2, 0, 1], [0, 2, 1], [2, 1, 0], [1, 0, 2]] {
                    let mut p = [0; 3];
                    let mut tet = vec![corner(0, 0, 0)];
                    for axis in path {
                        p[axis] = 1;
                        tet.push(corner(p[0], p[1], p[2]));
                    }
                    let odd = [[0, 2, 1], [2, 1, 0], [1, 0, 2]].contains(&path);
                    if odd {
                        tet.swap(2, 3);
                    }
                    elements.push(tet);
                }
            } else {
                let ring = |c| [corner(0, 0, c), corner(1, 0, c), corner(1, 1, c), corner(0, 1, c)];
                elements.push([ring(0), ring(1)].concat());
            }
        }
        let _ = writeln!(text, "$EndNodes\n$Elements\n{}", elements.len());
        let kind = if self.tetrahedra { 4 } else { 5 };
        for (e, corners) in elements.iter().enumerate() {
            let corners: Vec<String> = corners.iter().map(usize::to_string).collect();
            let _ = writeln!(text, "{} {kind} 2 1 1 {}", e + 1, corners.join(" "));
        }
        text += "$EndElements\n";
        let path = PathBuf::from(env!("CARGO_TARGET_TMPDIR")).join(format!("{name}.msh"));
        std::fs::write(&path, text).expect("written");
        path
    }
}

/// Returns the box that selects the plate's nodes between y = `low` and `high`.
fn across(low: f64, high: f64, scale: f64) -> String {
    format!(
        "{{ box = [[-1.0, {}, -1.0], [1.0, {}, 1.0]] }}",
        low * scale,
        high * scale
    )
}

/// Returns the scene of the plate in plane strain with the given loads; all lengths are multiplied by
/// `world`.
fn scene(plate: &Plate, name: &str, load: &str, world: f64) -> String {
    let file = plate.write(name, 1e-3);
    let (half, e) = (1.5 * WIDTH * world, 1e-6 * world);
    let mut text = format!(
        "[model.plate]\nkind = \"fem\"\nshape.file = {:?}\nscale = {}\n\
         material = {{ young = {YOUNG}, poisson = {POISSON}, density = 2700.0 }}\n",
        file.display().to_string(),
        1e-3 * world
    );
    // All nodes are held in z for plane strain, and two places hold the rigid motions in the plane.
    let far = WIDTH * world;
    for (from, to, axes) in [
        ([-9.0, -9.0, -e], [9.0, 9.0, 9.0], "\"z\""),
        ([far - e, -e, -9.0], [far + e, e, 9.0], "\"x\", \"y\""),
        ([far - e, half - e, -9.0], [far + e, half + e, 9.0], "\"x\""),
    ] {
        let _ = writeln!(
            text,
            "[[support]]\nmodel = \"plate\"\nwhere = {{ box = [{from:?}, {to:?}] }}\ncomponents = [{axes}]"
        );
    }
    text + load
}

/// Returns the loads that pull both ends.
fn pulled(world: f64) -> String {
    let half = 1.5 * WIDTH;
    let force = PULL * WIDTH * THICK * world * world;
    [-1.0, 1.0]
        .map(|side| {
            let place = across(side * half - 1e-6, side * half + 1e-6, world);
            format!(
                "[[load]]\nmodel = \"plate\"\nwhere = {place}\nforce = [0.0, {:e}, 0.0]\ntime = \"step\"\n",
                side * force
            )
        })
        .concat()
}

fn probe(name: &str, front: [f64; 3], direction: [f64; 3], radii: [f64; 2], ends: [f64; 2]) -> String {
    let end = |z: f64| [front[0], front[1], z];
    format!(
        "[probe.{name}]\nmodel = \"plate\"\nquantity = \"energy-release\"\n\
         crack = {{ front = [{:?}, {:?}], direction = {direction:?}, radii = {radii:?} }}\n",
        end(ends[0]),
        end(ends[1])
    )
}

/// Inner and outer radii \[m\] of three domains, small to large.
const DOMAINS: [[f64; 2]; 3] = [[4e-3, 8e-3], [8e-3, 12e-3], [5e-3, 16e-3]];

fn domains(crack: f64, world: f64) -> String {
    (0..DOMAINS.len())
        .map(|k| {
            let radii = DOMAINS[k].map(|r| r * world);
            probe(
                &format!("j{k}"),
                [crack * world, 0.0, 0.0],
                [1.0, 0.0, 0.0],
                radii,
                [0.0, THICK * world],
            )
        })
        .collect()
}

fn run(text: &str) -> Results {
    let scene = Scene::from_text(text.to_owned()).expect("a scene");
    scene.prepare().expect("built").run(&mut Silent).expect("runs")
}

fn read(results: &Results, name: &str) -> f64 {
    *results.probe(name).expect("probe").1.last().expect("a row")
}

/// Returns `J = K² (1 − ν²)/E`, `K = σ √(π a) F(a/W)` of Tada, Paris and Irwin, within 0.5 %.
fn handbook(crack: f64) -> f64 {
    let angle = PI * crack / (2.0 * WIDTH);
    let root = (angle.tan() / angle).sqrt();
    let f = root * (0.752 + 2.02 * crack / WIDTH + 0.37 * (1.0 - angle.sin()).powi(3)) / angle.cos();
    let k = PULL * (PI * crack).sqrt() * f;
    k * k * (1.0 - POISSON * POISSON) / YOUNG
}

const STATIC: &str = "[static]\nsteps = 1\n";

/// The released energy converges to the handbook's with the element size in every domain, in first order as
/// the energy at a crack does.
#[test]
fn an_edge_crack_releases_the_energy_of_the_handbook_whatever_the_domain() {
    let crack = 0.04;
    let exact = handbook(crack);
    for (tetrahedra, allowed) in [(false, 0.02), (true, 0.04)] {
        let release = |fine: f64| {
            let plate = Plate {
                crack,
                fine,
                layers: 1,
                tetrahedra,
            };
            let text = scene(&plate, &format!("sent-{tetrahedra}-{fine}"), &pulled(1.0), 1.0);
            let results = run(&(text + &domains(crack, 1.0) + STATIC));
            [0, 1, 2].map(|k| read(&results, &format!("j{k}")))
        };
        let [coarse, fine] = [2e-3, 1e-3].map(release);
        println!("tetrahedra {tetrahedra}: {coarse:.4?}, {fine:.4?} of {exact:.4}");
        for k in 0..3 {
            let [first, last] = [coarse[k] / exact - 1.0, fine[k] / exact - 1.0];
            assert!(
                last.abs() < allowed && (1.8..2.4).contains(&(first / last)),
                "{first}, {last}"
            );
            let limit = 2.0 * fine[k] - coarse[k];
            assert!((limit / exact - 1.0).abs() < 0.005, "{limit}");
            assert!((fine[k] / fine[0] - 1.0).abs() < 1e-3 && (coarse[k] / coarse[0] - 1.0).abs() < 4e-3);
        }
    }
}

/// The probe agrees with `J = ∂U/∂a` per thickness under given forces, from the energies of plates whose
/// cracks differ in length by a tenth.
#[test]
fn the_energy_of_the_plate_changes_by_what_the_probe_tells() {
    let with_crack = |crack: f64| {
        let plate = Plate {
            crack,
            fine: 2e-3,
            layers: 1,
            tetrahedra: false,
        };
        let text = scene(&plate, &format!("sent-change-{crack}"), &pulled(1.0), 1.0);
        let results = run(&(text + &domains(crack, 1.0) + STATIC));
        (read(&results, "j1"), results.summary().load_steps[0].energy)
    };
    let [low, middle, high] = [0.038, 0.04, 0.042].map(with_crack);
    // Simpson's rule over the released energies between the two lengths.
    let mean = (low.0 + 4.0 * middle.0 + high.0) / 6.0;
    let change = (high.1 - low.1) / (0.004 * THICK);
    println!("{mean} J/m2, by energies {change}");
    assert!((mean / change - 1.0).abs() < 0.005, "{mean}, {change}");
}

/// A plate in millimetres releases the same energy, and so does pressure on the crack faces in place of the
/// pull on the ends, by superposition.
#[test]
fn cracks_of_other_sizes_and_under_pressure_release_the_same() {
    let plate = Plate {
        crack: 0.04,
        fine: 2e-3,
        layers: 1,
        tetrahedra: true,
    };
    let release = |name: &str, load: &str, world: f64| {
        let text = scene(&plate, name, load, world) + &domains(plate.crack, world) + STATIC;
        let results = run(&text);
        [0, 1, 2].map(|k| read(&results, &format!("j{k}")))
    };
    let metres = release("sent-metres", &pulled(1.0), 1.0);
    let millimetres = release("sent-millimetres", &pulled(1e-3), 1e-3);
    let pressure = format!(
        "[[load]]\nmodel = \"plate\"\nwhere = {}\npressure = {PULL}\ntime = \"step\"\n",
        across(-1e-9, 1e-9, 1.0)
    );
    let opened = release("sent-pressure", &pressure, 1.0);
    println!("{metres:?}, pressure {opened:?}");
    for k in 0..3 {
        assert!(
            (millimetres[k] / metres[k] / 1e-3 - 1.0).abs() < 1e-9,
            "{millimetres:?}"
        );
        assert!((opened[k] / metres[k] - 1.0).abs() < 1e-3, "{opened:?}");
    }
}

/// Each part of the front of a plate in plane strain releases the same energy per length.
#[test]
fn a_part_of_the_front_within_the_body_releases_what_the_whole_does() {
    let plate = Plate {
        crack: 0.04,
        fine: 2e-3,
        layers: 8,
        tetrahedra: false,
    };
    let part = |name: &str, ends: [f64; 2]| {
        probe(name, [plate.crack, 0.0, 0.0], [1.0, 0.0, 0.3], [4e-3, 8e-3], ends)
    };
    let text = scene(&plate, "sent-part", &pulled(1.0), 1.0)
        + &part("whole", [0.0, THICK])
        + &part("inner", [0.25 * THICK, 0.75 * THICK])
        + &part("outer", [THICK, 0.5 * THICK])
        + STATIC;
    let results = run(&text);
    let [whole, inner, outer] = ["whole", "inner", "outer"].map(|n| read(&results, n));
    println!("{whole} {inner} {outer}");
    assert!((inner / whole - 1.0).abs() < 1e-3 && (outer / whole - 1.0).abs() < 1e-3);
}

/// Under a blow on the ends, where inertia enters the balance around the front, domains agree at every
/// instant.
#[test]
fn domains_agree_while_waves_pass_through_them() {
    let plate = Plate {
        crack: 0.04,
        fine: 2e-3,
        layers: 1,
        tetrahedra: false,
    };
    let text = scene(&plate, "sent-blow", &pulled(1.0), 1.0) + &domains(plate.crack, 1.0);
    let results = run(&(text + "[time]\nend = 60e-6\n[output]\nprobe_every = 4\n"));
    let j = [0, 1, 2].map(|k| results.probe(&format!("j{k}")).expect("probe").1.to_vec());
    let top = j[0].iter().fold(0.0_f64, |m, j| m.max(*j));
    let difference =
        |a: &[f64], b: &[f64]| a.iter().zip(b).fold(0.0_f64, |m, (a, b)| m.max((a - b).abs())) / top;
    println!(
        "up to {top} J/m2, apart by {} and {} of that",
        difference(&j[0], &j[1]),
        difference(&j[0], &j[2])
    );
    println!("{:.3?}", j[0].iter().step_by(10).collect::<Vec<_>>());
    assert!(top > handbook(plate.crack));
    assert!(difference(&j[0], &j[1]) < 0.02 && difference(&j[0], &j[2]) < 0.02);
}

/// Returns a block of any kind with a notch one element wide.
fn notched(kind: &str, front: &str) -> String {
    format!(
        "[model.block]\nkind = \"{kind}\"\ndivisions = [16, 15, 2]\n\
         shape.box = {{ low = [0.0, 0.0, 0.0], high = [0.16, 0.15, 0.02], hole = {{ low = [0.0, 0.07, 0.0], high = [0.06, 0.08, 0.02] }} }}\n\
         material = {{ young = {YOUNG}, poisson = {POISSON}, density = 2700.0 }}\n\
         [[support]]\nmodel = \"block\"\nwhere = \"y-min\"\n\
         [[load]]\nmodel = \"block\"\nwhere = \"y-max\"\nforce = [0.0, 1e4, 0.0]\ntime = \"step\"\n\
         [probe.j]\nmodel = \"block\"\n{front}\n"
    )
}

const FRONT: &str = "quantity = \"energy-release\"\ncrack = { front = [[0.06, 0.075, 0.0], [0.06, 0.075, 0.02]], \
                     direction = [1.0, 0.0, 0.0], radii = [0.02, 0.05] }";

/// The energies released at a notch of finite elements (too stiff) and of natural elements (too soft) nearly
/// agree.
#[test]
fn notches_of_finite_and_of_natural_elements_release_about_the_same() {
    let gaps = ["[16, 15, 2]", "[32, 30, 2]"].map(|divisions| {
        let text = |kind: &str| notched(kind, FRONT).replace("[16, 15, 2]", divisions) + STATIC;
        let [fem, cnem] = ["fem", "cnem"].map(|kind| read(&run(&text(kind)), "j"));
        println!("{fem} and {cnem} J/m2");
        cnem / fem - 1.0
    });
    assert!(
        gaps[1] > 0.0 && gaps[1] < 0.65 * gaps[0] && gaps[1] < 0.1,
        "{gaps:?}"
    );
}

fn assert_refused(text: &str, place: &str, words: &str) {
    let prepared = Scene::from_text(text.to_owned()).and_then(|s| s.prepare().map(|_| ()));
    let error = prepared.expect_err(&format!("taken: {text}"));
    assert_eq!(error.place().0, Some(place), "{error}");
    assert!(error.to_string().contains(words), "{error}");
}

#[test]
fn cracks_that_make_no_sense_are_refused_by_name() {
    let edited = |from: &str, to: &str| {
        assert!(FRONT.contains(from), "{from}");
        notched("fem", &FRONT.replace(from, to)) + STATIC
    };
    let place = "probe.j.crack";
    let wrong = [
        (
            "[0.02, 0.05]",
            "[0.0, 0.05]",
            "radii of the crack front = [0, 0.05]: must be positive",
        ),
        (
            "[0.02, 0.05]",
            "[0.05, 0.02]",
            "the inner one below the outer one",
        ),
        (
            "[0.06, 0.075, 0.02]]",
            "[0.06, 0.075, 0.0]]",
            "two different points",
        ),
        ("[1.0, 0.0, 0.0]", "[0.0, 0.0, 2.0]", "not lie along the front"),
        ("[1.0, 0.0, 0.0]", "[0.0, 0.0, 0.0]", "must have a length"),
        (
            "0.02]]",
            "0.03]]",
            "is not there, an inner radius ahead of the crack front",
        ),
        ("[1.0, 0.0, 0.0]", "[-1.0, 0.0, 0.0]", "turn the direction"),
        (
            "[0.02, 0.05]",
            "[0.02, 0.12]",
            "a surface there that is not parallel to the direction",
        ),
        (
            "[1.0, 0.0, 0.0]",
            "[1.0, 1.0, 0.0]",
            "faces of the crack that are not along the direction",
        ),
        (
            "\"energy-release\"",
            "\"stress\"",
            "quantity = \"energy-release\"",
        ),
    ];
    for (from, to, words) in wrong {
        assert_refused(&edited(from, to), place, words);
    }
    let [front, far] = [
        "[[0.06, 0.075, 0.0], [0.06, 0.075, 0.02]]",
        "[[0.1, 0.11, 0.0], [0.1, 0.11, 0.02]]",
    ];
    let solid = edited(front, far).replace("[0.02, 0.05]", "[0.01, 0.02]");
    assert_refused(&solid, place, "no surface of a crack within this distance");
    let extended = |extended: &str| notched("fem", &format!("{FRONT}\n{extended}")) + STATIC;
    assert_refused(&extended("component = \"x\""), "probe.j.component", "remove it");
    assert_refused(
        &extended("where = \"x-min\""),
        "probe.j",
        "exactly one of at, where, of, crack",
    );
    let bare = notched("fem", "quantity = \"energy-release\"\nwhere = \"x-min\"") + STATIC;
    assert_refused(&bare, "probe.j.quantity", "is that of a crack");
    let stressed = notched("fem", FRONT) + "[[effect]]\nprestress = {}\n[time]\nsteps = 1\n";
    assert_refused(&stressed, place, "effect[0].prestress");
}

/// A crack near the overlap of two boxes, or in a model of particles, is refused.
#[test]
fn cracks_in_an_overlap_and_among_particles_are_refused() {
    let text = |model: &str, fine: &str, x: f64| {
        format!(
            "[model.left]\nkind = \"fem\"\nrole = \"coarse\"\ndivisions = [8, 8, 2]\n\
             shape.box = {{ low = [0.0, 0.0, 0.0], high = [8.0, 8.0, 2.0], hole = {{ low = [0.0, 3.0, 0.0], high = [2.0, 4.0, 2.0] }} }}\n\
             material = {{ young = 1.0, poisson = 0.25, density = 1.0 }}\n\
             [model.right]\n{fine}\nrole = \"fine\"\nshape.box = {{ low = [6.0, 0.0, 0.0], high = [12.0, 8.0, 2.0] }}\n\
             material = {{ young = 1.0, poisson = 0.25, density = 1.0 }}\n\
             [interface.joint]\ncoarse = \"left\"\nfine = \"right\"\noverlap.slab = {{ coarse = [6.0, 0.0, 0.0], fine = [8.0, 0.0, 0.0] }}\n\
             mediator = {{ spacing = 1.0, shape.box = {{ low = [6.0, 0.0, 0.0], high = [8.0, 8.0, 2.0] }} }}\n\
             [probe.j]\nmodel = \"{model}\"\nquantity = \"energy-release\"\n\
             crack = {{ front = [[{x}, 3.5, 0.0], [{x}, 3.5, 2.0]], direction = [1.0, 0.0, 0.0], radii = [1.1, 1.9] }}\n\
             [time]\nsteps = 1\n"
        )
    };
    let elements = "kind = \"fem\"\nspacing = 0.5";
    let scene = Scene::from_text(text("left", elements, 2.0)).expect("a scene");
    scene.prepare().expect("a crack beside the overlap");
    assert_refused(
        &text("left", elements, 5.0),
        "probe.j.crack",
        "reaches into an overlap",
    );
    let spheres = "kind = \"dem\"\nspacing = 0.5\ndem.protocol = \"quench\"";
    assert_refused(
        &text("right", spheres, 9.0),
        "probe.j.crack",
        "cannot tell the energy that a crack releases",
    );
}

/// Parts of the front that end between nodes release the same energy per length as the whole front, in plane
/// strain.
#[test]
fn parts_of_the_front_that_end_between_nodes_release_the_same() {
    let plate = Plate {
        crack: 0.04,
        fine: 2e-3,
        layers: 8,
        tetrahedra: false,
    };
    let part = |name: &str, ends: [f64; 2]| {
        probe(name, [plate.crack, 0.0, 0.0], [1.0, 0.0, 0.0], [4e-3, 8e-3], ends)
    };
    let text = scene(&plate, "sent-between", &pulled(1.0), 1.0)
        + &part("whole", [0.0, THICK])
        + &part("inner", [0.2 * THICK, 0.69 * THICK])
        + &part("short", [0.45 * THICK, 0.62 * THICK])
        + STATIC;
    let results = run(&text);
    let [whole, inner, short] = ["whole", "inner", "short"].map(|n| read(&results, n));
    println!("{whole} {inner} {short}");
    assert!((inner / whole - 1.0).abs() < 0.01 && (short / whole - 1.0).abs() < 0.01);
}

/// A front within the slit, and a direction that points back along its faces, are refused.
#[test]
fn fronts_within_a_slit_and_directions_along_its_faces_are_refused() {
    let plate = Plate {
        crack: 0.04,
        fine: 2e-3,
        layers: 1,
        tetrahedra: false,
    };
    for (x, along) in [(0.04, -1.0), (0.034, 1.0), (0.03, 1.0)] {
        let front = probe("j", [x, 0.0, 0.0], [along, 0.0, 0.0], [4e-3, 8e-3], [0.0, THICK]);
        let text = scene(&plate, "sent-within", &pulled(1.0), 1.0) + &front + STATIC;
        let prepared = Scene::from_text(text).and_then(|s| s.prepare().map(|_| ()));
        let error = prepared.expect_err("refused");
        assert_eq!(error.place().0, Some("probe.j.crack"), "{error}");
    }
}

/// A body cut in half along its crack releases half of the energy, with supports ahead of the front whose
/// forces do not count as loads.
#[test]
fn half_a_body_releases_half() {
    let (crack, thick) = (0.04, 0.004);
    let support = |from: [f64; 3], to: [f64; 3], axis: &str| {
        format!(
            "[[support]]\nmodel = \"plate\"\nwhere = {{ box = [{from:?}, {to:?}] }}\ncomponents = [\"{axis}\"]\n"
        )
    };
    let mut text = format!(
        "[model.plate]\nkind = \"fem\"\ndivisions = [50, 75, 1]\n\
         shape.box = {{ low = [0.0, 0.0, 0.0], high = [0.1, 0.15, {thick}] }}\n\
         material = {{ young = {YOUNG}, poisson = {POISSON}, density = 2700.0 }}\n\
         [[load]]\nmodel = \"plate\"\nwhere = \"y-max\"\ntraction = [0.0, {PULL}, 0.0]\ntime = \"step\"\n"
    );
    text += &support([-1.0, -1.0, -1e-6], [1.0, 1.0, 1.0], "z");
    text += &support([crack - 1e-6, -1e-6, -1.0], [1.0, 1e-6, 1.0], "y");
    text += &support([0.0999, 0.1499, -1.0], [1.0, 1.0, 1.0], "x");
    for (name, radii) in [("near", [4e-3, 8e-3]), ("far", [8e-3, 14e-3])] {
        text += &probe(name, [crack, 0.0, 0.0], [1.0, 0.0, 0.0], radii, [0.0, thick]);
    }
    let results = run(&(text + STATIC));
    let [near, far] = ["near", "far"].map(|n| read(&results, n));
    let exact = 0.5 * handbook(crack);
    println!("{near} and {far} of {exact}");
    assert!((near / far - 1.0).abs() < 2e-3 && (far / exact - 1.0).abs() < 0.04);
}
