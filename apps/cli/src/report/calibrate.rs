//! Report of `arlequin calibrate` as text: packings, elastic constants, strengths.

use arlequin_scene::calibrate::{
    Beams, Calibration, Elastic, Estimate, Exponent, Strengths, ToughnessResult,
};

/// Returns the report as lines of text.
pub(crate) fn text(r: &Calibration) -> String {
    let mut out = String::new();
    let mut line = |text: String| {
        out.push_str(text.trim_end());
        out.push('\n');
    };
    line(format!("sample     {}", r.sample));
    for n in &r.notes {
        line(format!("note       {n}"));
    }
    line(format!("beams      {}", beams(&r.beams)));
    line(String::new());
    let last = if r.elastic.young_gauge.is_some() {
        "E middle"
    } else {
        "anisotropy"
    };
    line(format!(
        "{:>6} {:>8} {:>7} {:>6} {:>6} {:>7} {:>8} {:>9} {:>11} {:>11} {:>7}",
        "seed",
        "spheres",
        "dropped",
        "z all",
        "z kept",
        "z inner",
        "fraction",
        "overlap",
        "E [Pa]",
        last,
        "nu"
    ));
    for p in &r.packings {
        let seed = p.seed.map_or("file".to_owned(), |s| s.to_string());
        let inner = p
            .coordination_interior
            .map_or("-".to_owned(), |z| format!("{z:.3}"));
        let last_value = match (p.young_gauge, p.anisotropy) {
            (Some(e), _) => format!("{e:.4e}"),
            (None, a) => a.map_or(String::new(), |a| format!("{a:.4}")),
        };
        line(format!(
            "{seed:>6} {:>8} {:>7} {:>6.3} {:>6.3} {inner:>7} {:>8.4} {:>9.2e} {:>11.4e} {last_value:>11} {:>7.4}",
            p.spheres,
            p.dropped,
            p.coordination_all,
            p.coordination_retained,
            p.volume_fraction,
            p.mean_overlap,
            p.young,
            p.poisson
        ));
    }
    line(String::new());
    let single = r.packings.len() == 1;
    for text in elastic(&r.elastic, single) {
        line(text);
    }
    if let Some(t) = &r.target {
        line(String::new());
        line(format!("target     E = {:.4e} Pa, nu = {}", t.young, t.poisson));
        line(format!("beams      {}", beams(&t.beams)));
        for text in elastic(&t.reached, single) {
            line(text);
        }
    }
    if let Some(s) = &r.strength {
        line(String::new());
        for text in strengths(s) {
            line(text);
        }
    }
    if let Some(t) = &r.toughness {
        line(String::new());
        for text in toughness(t, r.elastic.young.mean) {
            line(text);
        }
    }
    for w in &r.warnings {
        line(format!("warning    {w}"));
    }
    if let Some(why) = &r.refused {
        line(format!("refused    {why}"));
    }
    out
}

fn beams(b: &Beams) -> String {
    format!(
        "Young's modulus {:.4e} Pa, Poisson's ratio {}, radius {:.4} of the mean particle radius",
        b.young, b.poisson, b.radius_ratio
    )
}

/// Returns one line per constant. The spread is the sample standard deviation over the packings, which a
/// single packing does not have.
fn elastic(e: &Elastic, single: bool) -> Vec<String> {
    let modulus = |name: &str, b: &Estimate| match single {
        true => format!("{name:<10} {:.4e} Pa (one packing)", b.mean),
        false => format!("{name:<10} {:.4e} Pa ± {:.1e}", b.mean, b.deviation),
    };
    let ratio = |name: &str, b: &Estimate| match single {
        true => format!("{name:<10} {:.4} (one packing)", b.mean),
        false => format!("{name:<10} {:.4} ± {:.4}", b.mean, b.deviation),
    };
    let mut out = vec![modulus("E", &e.young)];
    out.extend(e.young_gauge.iter().map(|b| modulus("E middle", b)));
    out.push(ratio("nu", &e.poisson));
    out.extend(e.anisotropy.iter().map(|b| ratio("anisotropy", b)));
    out
}

/// Returns the lines of the strength table.
fn strengths(s: &Strengths) -> Vec<String> {
    let scatter = s
        .weibull
        .map_or("no scatter".to_owned(), |m| format!("Weibull modulus {m}"));
    let mut out = vec![
        format!(
            "strength   of beams {:.4e} Pa ({:.4e} J/m2 by energy), {scatter}; bars pulled until they break",
            s.beam_strength, s.beam_energy
        ),
        format!(
            "{:>10} {:>9} {:>8} {:>22} {:>16} {:>16} {:>9} {:>8}",
            "criterion",
            "d [m]",
            "spheres",
            "bar [Pa]",
            "beams over bar",
            "first over peak",
            "strain",
            "broken"
        ),
    ];
    out.extend(s.rows.iter().map(|r| {
        format!(
            "{:>10} {:>9.3e} {:>8} {:>11.4e} ± {:>8.1e} {:>7.3} ± {:>6.3} {:>7.3} ± {:>6.3} {:>9.3e} {:>6.2} %",
            r.criterion,
            r.diameter,
            r.spheres,
            r.body.mean,
            r.body.deviation,
            r.ratio.mean,
            r.ratio.deviation,
            r.first.mean,
            r.first.deviation,
            r.strain.mean,
            100.0 * r.broken.mean
        )
    }));
    let power = |e: &Exponent| {
        format!(
            "{:>10} goes as the diameter to the power {:+.2}",
            e.criterion, e.power
        )
    };
    out.extend(s.exponents.iter().map(power));
    out
}

/// Returns the lines of the toughness table.
fn toughness(t: &ToughnessResult, young: f64) -> Vec<String> {
    let unit = if t.gc.is_some() || t.tensile_strength.is_some() {
        "J/m2"
    } else {
        "Pa"
    };
    let meant = t.gc.map_or(String::new(), |gc| format!(", for gc = {gc:e} J/m2"));
    let mut out = vec![
        format!(
            "toughness  of strips {:e} by {:e} by {:e} m, spheres of {:.3e} m; bonds break by {} at {:.4e} {unit}{meant}",
            t.strip[0], t.strip[1], t.strip[2], t.diameter, t.criterion, t.bond_strength
        ),
        format!(
            "{:>6} {:>13} {:>9} {:>9} {:>9} {:>9} {:>9} {:>10} {:>7}",
            "seed", "elongation[m]", "J", "lost", "released", "theory", "first", "bonds/m2", "v/c"
        ),
    ];
    out.extend(t.strips.iter().map(|s| {
        let seed = s.seed.map_or("file".to_owned(), |s| s.to_string());
        format!(
            "{seed:>6} {:>13.4e} {:>9.3} {:>9.3} {:>9.3} {:>9.3} {:>9.3} {:>10.3e} {:>7.4}",
            s.elongation, s.j, s.lost, s.released, s.theory, s.first, s.broken, s.speed
        )
    }));
    let energy = |name: &str, e: &Estimate| match t.strips.len() {
        1 => format!("{name:<46} {:.3} J/m2 (one strip)", e.mean),
        _ => format!("{name:<46} {:.3} J/m2 ± {:.3}", e.mean, e.deviation),
    };
    out.push(energy("J of finite elements at the same elongation", &t.j));
    out.push(energy("lost by the strip: released and waves", &t.lost));
    out.push(energy("strip theory", &t.theory));
    out.push(energy("released with the bonds", &t.released));
    out.push(format!(
        "the first three differ by {:.1} %; a slow crack takes {:.2} times what its bonds release, the rest leaves as waves",
        100.0 * t.difference,
        t.lost.mean / t.released.mean
    ));
    if let Some(strength) = t.tensile_strength {
        out.push(format!(
            "implied    a plain body of these spheres fails in tension at about {strength:.3e} Pa (E = {young:.3e} Pa)"
        ));
    }
    if let Some(both) = t.diameter_of_both {
        out.push(format!(
            "implied    the wanted strength goes with this toughness for spheres of {both:.3e} m"
        ));
    }
    out
}
