//! A bounding volume hierarchy, split by the surface-area heuristic over buckets (Wald, *On fast construction of SAH-based bounding
//! volume hierarchies*, RT 2007).

use glam::DVec3;
use itertools::{Itertools, partition};

use fathom_scene::Bounds;

const BUCKETS: usize = 8;
/// Subtrees of more shapes are built by several threads.
const PARALLEL: usize = 4096;

/// Half the surface of a box.
fn area(bounds: &Bounds) -> f64 {
    let [x, y, z] = bounds.size().to_array();
    x * y + y * z + z * x
}

/// Distance at which a ray enters the box, 0 from inside, by one over its direction.
pub fn entry(bounds: &Bounds, origin: DVec3, inverse: DVec3) -> Option<f64> {
    let (a, b) = ((bounds.min - origin) * inverse, (bounds.max - origin) * inverse);
    // Zero times infinity: the ray lies in the plane of a side, and so between the two of this axis.
    let between = a.is_nan_mask() | b.is_nan_mask();
    let near = DVec3::select(between, DVec3::NEG_INFINITY, a.min(b)).max_element().max(0.0);
    let far = DVec3::select(between, DVec3::INFINITY, a.max(b)).min_element();
    (near <= far).then_some(near)
}

/// A shape by its index, or two nodes by theirs, with their boxes.
#[derive(Clone, Copy)]
pub enum Node {
    Leaf(usize),
    Inner([(Bounds, usize); 2]),
}

/// The nodes over shapes with these boxes, the root first; none without shapes.
pub fn nodes(boxes: &[Bounds]) -> Vec<Node> {
    let mut shapes = (0..boxes.len()).collect_vec();
    let mut nodes = vec![Node::Leaf(0); (2 * boxes.len()).saturating_sub(1)];
    if !boxes.is_empty() {
        build(boxes, &mut shapes, 0, &mut nodes);
    }
    nodes
}

/// The subtree over these shapes: twice as many nodes less one, of which the first has the index `start`.
fn build(boxes: &[Bounds], shapes: &mut [usize], start: usize, nodes: &mut [Node]) {
    if let [shape] = shapes {
        nodes[0] = Node::Leaf(*shape);
        return;
    }
    let count = shapes.len();
    let middle = split(boxes, shapes);
    let (left, right) = shapes.split_at_mut(middle);
    let (left_start, right_start) = (start + 1, start + 2 * middle);
    nodes[0] =
        Node::Inner([(around(boxes, left), left_start), (around(boxes, right), right_start)]);
    let (left_nodes, right_nodes) = nodes[1..].split_at_mut(2 * middle - 1);
    let mut build_left = || build(boxes, left, left_start, left_nodes);
    let mut build_right = || build(boxes, right, right_start, right_nodes);
    if count > PARALLEL {
        rayon::join(build_left, build_right);
    } else {
        build_left();
        build_right();
    }
}

fn around(boxes: &[Bounds], shapes: &[usize]) -> Bounds {
    shapes.iter().fold(Bounds::EMPTY, |all, shape| all.union(boxes[*shape]))
}

/// Reorders at least two shapes so that the first ones become one child; how many these are.
fn split(boxes: &[Bounds], shapes: &mut [usize]) -> usize {
    let centers = Bounds::around(shapes.iter().map(|shape| boxes[*shape].center()));
    let axis = centers.size().max_position();
    let scale = BUCKETS as f64 / centers.size()[axis];
    if !scale.is_finite() {
        return shapes.len() / 2;
    }
    let bucket = |shape: &usize| {
        let along = (boxes[*shape].center() - centers.min)[axis] * scale;
        (along as usize).min(BUCKETS - 1)
    };
    let mut filled = [(Bounds::EMPTY, 0); BUCKETS];
    for shape in shapes.iter() {
        let (bounds, count) = &mut filled[bucket(shape)];
        *bounds = bounds.union(boxes[*shape]);
        *count += 1;
    }
    // The first and the last bucket hold a shape each, so neither side is empty.
    let cost = |side: &[(Bounds, usize)]| {
        let bounds = side.iter().fold(Bounds::EMPTY, |all, (bounds, _)| all.union(*bounds));
        area(&bounds) * side.iter().map(|(_, count)| *count as f64).sum::<f64>()
    };
    let costs = (1..BUCKETS).map(|end| cost(&filled[..end]) + cost(&filled[end..]));
    let best = 1 + costs.position_min_by(f64::total_cmp).unwrap_or(0);
    partition(&mut *shapes, |shape| bucket(shape) < best)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn boxes(centers: impl Iterator<Item = DVec3>) -> Vec<Bounds> {
        centers.map(|c| Bounds { min: c - DVec3::ONE, max: c + DVec3::ONE }).collect()
    }

    /// Each shape is one leaf, within the boxes of all nodes above it.
    fn is_sound(boxes: &[Bounds]) {
        let nodes = nodes(boxes);
        let mut found = vec![0; boxes.len()];
        let mut open = vec![(0, Vec::new())];
        while let Some((node, above)) = open.pop() {
            match nodes[node] {
                Node::Leaf(shape) => {
                    found[shape] += 1;
                    let holds = |b: &Bounds| b.union(boxes[shape]) == *b;
                    assert!(above.iter().all(holds));
                }
                Node::Inner(children) => open.extend(children.map(|(bounds, child)| {
                    (child, above.iter().copied().chain([bounds]).collect())
                })),
            }
        }
        assert!(found.iter().all(|count| *count == 1));
    }

    #[test]
    fn every_shape_is_a_leaf_within_its_boxes() {
        let spread = |i: i32| DVec3::new(f64::from(i * i % 101), f64::from(i % 7), f64::from(i));
        for count in [1, 2, 3, 100, 10_000] {
            is_sound(&boxes((0..count).map(spread)));
            is_sound(&boxes((0..count).map(|_| DVec3::ONE)));
        }
        assert!(nodes(&[]).is_empty());
    }

    #[test]
    fn a_ray_enters_a_box_where_it_meets_it() {
        let bounds = Bounds { min: DVec3::NEG_ONE, max: DVec3::ONE };
        let entry = |origin: DVec3, along: DVec3| entry(&bounds, origin, along.recip());
        assert_eq!(entry(DVec3::new(-3.0, 0.5, 0.0), DVec3::X), Some(2.0));
        assert_eq!(entry(DVec3::ZERO, DVec3::Y), Some(0.0));
        assert_eq!(entry(DVec3::new(-3.0, 0.5, 0.0), DVec3::NEG_X), None);
        assert_eq!(entry(DVec3::new(-3.0, 1.5, 0.0), DVec3::X), None);
        // Along sides and an edge.
        assert_eq!(entry(DVec3::new(-3.0, 1.0, 0.0), DVec3::X), Some(2.0));
        assert_eq!(entry(DVec3::new(-3.0, -1.0, 1.0), DVec3::X), Some(2.0));
    }
}
