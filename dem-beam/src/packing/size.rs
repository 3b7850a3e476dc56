//! Size and number of the spheres of a packing, estimated before it is made.

/// Volume fraction at which spheres jam in a body with walls; it is below that of the bulk, as spheres lie
/// less densely at walls.
pub const JAMMED: f64 = 0.615;

/// Volume fraction at which spheres jam in the bulk (in a periodic box).
pub const JAMMED_PERIODIC: f64 = 0.64;

/// Default half width of the uniform radius distribution over the mean radius.
pub const SPREAD: f64 = 0.25;

/// Returns the mean volume \[m³\] of spheres of mean diameter `diameter` \[m\]. With radii within [`SPREAD`]
/// of the mean, the mean cube of the radii is 1.0625 times the cube of the mean.
#[must_use]
pub fn mean_sphere_volume(diameter: f64) -> f64 {
    std::f64::consts::PI / 6.0 * diameter.powi(3) * (1.0 + SPREAD.powi(2))
}

/// Returns the number, not rounded, of spheres of mean diameter `diameter` \[m\] that jam in a body of
/// `volume` \[m³\] with walls.
///
/// ```
/// use dem_beam::packing::size::{mean_diameter, sphere_count};
/// let count = sphere_count(1e-6, 1e-3);
/// assert!((count - 1105.5).abs() < 0.1 && (mean_diameter(1e-6, count) / 1e-3 - 1.0).abs() < 1e-12);
/// ```
#[must_use]
pub fn sphere_count(volume: f64, diameter: f64) -> f64 {
    JAMMED * volume / mean_sphere_volume(diameter)
}

/// Returns the mean diameter \[m\] of `count` spheres that jam in a body of `volume` \[m³\]: the inverse of
/// [`sphere_count`].
#[must_use]
pub fn mean_diameter(volume: f64, count: f64) -> f64 {
    (JAMMED * volume / count / mean_sphere_volume(1.0)).cbrt()
}
