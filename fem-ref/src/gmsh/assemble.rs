//! Makes a mesh from the contents of a file.

use super::contents::{Block, Contents};
use super::fault;
use crate::check::{NodeSet, node_set};
use crate::element::ElementKind;
use crate::error::Result;
use crate::mesh::{Facet, Mesh};
use arlequin_core::Real;
use mshio::mshfile::ElementType;
use std::collections::{BTreeMap, HashMap};

/// Makes the mesh of the elements that fill the domain.
pub(super) fn mesh<T: Real>(file: &Contents) -> Result<Mesh<T>> {
    let kind = element_kind(&file.blocks)?;
    let nodes = file.nodes.iter().map(|x| x.map(T::of)).collect();
    let Filling {
        connectivity,
        volumes,
        regions,
        repeated,
    } = Filling::collect(file, kind)?;
    let mut mesh = Mesh::with_volumes(kind, nodes, connectivity, volumes, regions)?;
    for (name, group) in collect_groups(file)? {
        add_group(&mut mesh, &name, group);
    }
    let mut notices = file.notices.clone();
    if repeated > 0 {
        notices.push(format!(
            "{repeated} of its elements are listed a second time, with the same nodes on the same entity: each is read once"
        ));
    }
    if mesh.doubled() > 0 {
        notices.push(format!(
            "{} nodes lie at the place of another one, on faces that face each other: they are taken for the lips of a slit",
            mesh.doubled()
        ));
    }
    mesh.set_notices(notices);
    // Last: the numbers of a file jump, and with them memory accesses.
    Ok(mesh.renumbered())
}

/// Elements that fill the domain, each once, and their volumes.
#[derive(Default)]
struct Filling {
    connectivity: Vec<u32>,
    /// Names of the volumes: physical groups, or entities without one; empty for bars.
    volumes: Vec<String>,
    /// For every element, the number of its volume.
    regions: Vec<u32>,
    /// Number of elements that were left out as repetitions.
    repeated: usize,
}

impl Filling {
    /// Collects the elements.
    fn collect(file: &Contents, kind: ElementKind) -> Result<Self> {
        let mut out = Self::default();
        // By the set of nodes: the order of corners differs between listings.
        let mut known: HashMap<NodeSet, (i32, u64)> = HashMap::new();
        for block in domain(file, kind) {
            let number = (kind != ElementKind::Bar2).then(|| out.volume(file, block));
            for element in &block.elements {
                let corners = file.corners(element)?;
                match known.insert(node_set(&corners), (block.entity, element.element_tag)) {
                    None => {
                        out.connectivity.extend(corners);
                        out.regions.extend(number);
                    }
                    // A second listing on the same entity is a repetition and left out. On another entity it
                    // means that two volumes lie at one place, perhaps of two materials.
                    Some((entity, _)) if entity == block.entity => out.repeated += 1,
                    Some((entity, tag)) => {
                        return Err(fault(format!(
                            "element {tag} of entity {entity} and element {} of entity {} have the same nodes, so that mass and \
                             stiffness would count twice there; remove one of the entities, which lie in one place, or the \
                             repeated elements (removeDuplicateElements of Gmsh)",
                            element.element_tag, block.entity
                        )));
                    }
                }
            }
        }
        Ok(out)
    }

    /// Number of the volume of a block; new names are added.
    fn volume(&mut self, file: &Contents, block: &Block) -> u32 {
        let name = match block.physical.first().map(|t| t.saturating_abs()) {
            Some(tag) => {
                let group_name = file.names.get(&(3, tag)).cloned();
                group_name.unwrap_or_else(|| format!("volume-{tag}"))
            }
            None => format!("entity {}", block.entity),
        };
        let number = self.volumes.iter().position(|n| *n == name);
        number.unwrap_or_else(|| {
            self.volumes.push(name);
            self.volumes.len() - 1
        }) as u32
    }
}

/// Blocks of the elements that fill the domain.
fn domain(file: &Contents, kind: ElementKind) -> impl Iterator<Item = &Block> {
    let wanted = gmsh_type(kind);
    file.blocks.iter().filter(move |b| b.element_type == wanted)
}

fn gmsh_type(kind: ElementKind) -> ElementType {
    match kind {
        ElementKind::Bar2 => ElementType::Lin2,
        ElementKind::Tet4 => ElementType::Tet4,
        ElementKind::Hex8 => ElementType::Hex8,
    }
}

/// Determines the one element kind that fills the domain.
fn element_kind(blocks: &[Block]) -> Result<ElementKind> {
    let count = |t: ElementType| -> usize {
        let matching = blocks.iter().filter(|b| b.element_type == t);
        matching.map(|b| b.elements.len()).sum()
    };
    use ElementType::{Hex8, Lin2, Pnt, Qua4, Tet4, Tri3};
    let known = [Pnt, Lin2, Tri3, Qua4, Tet4, Hex8];
    if let Some(block) = blocks.iter().find(|b| !known.contains(&b.element_type)) {
        let t = block.element_type;
        return Err(fault(format!(
            "{} elements of type {t:?} are not supported; use Lin2, Tet4 or Hex8 of first order",
            count(t)
        )));
    }
    match (count(Tet4), count(Hex8)) {
        (0, 0) => {}
        (_, 0) => return Ok(ElementKind::Tet4),
        (0, _) => return Ok(ElementKind::Hex8),
        (tets, hexes) => {
            return Err(fault(format!(
                "{tets} Tet4 and {hexes} Hex8 elements are mixed; mesh all volumes with one kind"
            )));
        }
    }
    match (count(Tri3) + count(Qua4), count(Lin2)) {
        (0, 0) => Err(fault(
            "there is no Lin2, Tet4 or Hex8 element; mesh curves or volumes",
        )),
        (0, _) => Ok(ElementKind::Bar2),
        (faces, _) => Err(fault(format!(
            "{faces} Tri3 and Qua4 elements bound no volume; mesh in three dimensions"
        ))),
    }
}

/// Elements of one physical group as node lists, with their dimension.
type RawGroup = Vec<(i32, Vec<u32>)>;

/// Elements of the physical groups, by name.
pub(super) fn collect_groups(file: &Contents) -> Result<BTreeMap<String, RawGroup>> {
    let mut groups: BTreeMap<String, RawGroup> = BTreeMap::new();
    for block in &file.blocks {
        let dimension = block.dimension;
        for tag in &block.physical {
            // A negative tag means that the entity is reversed in the group.
            let tag = tag.saturating_abs();
            let word = usize::try_from(dimension).ok();
            let word = word.and_then(|d| ["point", "curve", "surface", "volume"].get(d));
            let name = file.names.get(&(dimension, tag)).cloned();
            let group = groups
                .entry(name.unwrap_or_else(|| format!("{}-{tag}", word.unwrap_or(&"part"))))
                .or_default();
            for element in &block.elements {
                group.push((dimension, file.corners(element)?));
            }
        }
    }
    Ok(groups)
}

fn add_group<T: Real>(mesh: &mut Mesh<T>, name: &str, group: RawGroup) {
    let facet_dimension = match mesh.kind() {
        ElementKind::Bar2 => 0,
        ElementKind::Tet4 | ElementKind::Hex8 => 2,
    };
    let sorted = |mut nodes: Vec<u32>| {
        nodes.sort_unstable();
        nodes
    };
    // Searched for only if the group has faces: the boundary is a pass over all elements.
    let mut faces: HashMap<Vec<u32>, Facet> = HashMap::new();
    if group.iter().any(|(d, _)| *d == facet_dimension) {
        let boundary = mesh.boundary();
        faces.extend(boundary.into_iter().map(|f| (sorted(mesh.facet_nodes(f)), f)));
    }
    let (mut nodes, mut facets) = (Vec::new(), Vec::new());
    for (dimension, corners) in group {
        nodes.extend_from_slice(&corners);
        if dimension == facet_dimension {
            facets.extend(faces.get(&sorted(corners)));
        }
    }
    mesh.set_group(name, nodes, facets);
}
