//! A tree grown by a bracketed L-system: Prusinkiewicz and Lindenmayer, *The Algorithmic Beauty of Plants*, chapters 1 and 2.

use glam::{DQuat, DVec3};

use super::Dice;
use crate::Mesh;
use crate::shapes::{merged, scaled, tube};

const SEED: u32 = 1;
/// Rewritings of each bud: 2¹¹ twigs.
const GENERATIONS: usize = 11;
/// Height, and radius of the trunk, metres.
const HEIGHT: f64 = 4.0;
const RADIUS: f64 = 0.09;
/// Angle of a branch to the one that bears it.
const ANGLE_DEG: f64 = 44.0;

/// A module of the L-system. All lengths are relative; the tree is scaled in the end.
#[derive(Clone, Copy)]
enum Module {
    /// What the rule rewrites: a bud that goes on with segments of this length.
    Apex {
        length: f64,
    },
    Segment {
        length: f64,
    },
    /// Away from the heading, radians.
    Turn(f64),
    /// About the heading, radians.
    Roll(f64),
    /// Starts a branch, and goes back to where it started.
    Push,
    Pop,
}

/// The seedling: a bare piece of trunk, and its bud.
const AXIOM: [Module; 2] = [Module::Segment { length: 1.8 }, Module::Apex { length: 1.0 }];

/// Where leaves stand around a stem: the golden angle.
const DIVERGENCE_DEG: f64 = 137.508;
/// Length of a segment against the one before: on the same branch, and on a new one. Tuned by eye.
const LEADING: f64 = 0.9;
const SIDE: f64 = 0.84;
/// The bearing branch turns away from a new one by this share of the angle.
const RECOIL: f64 = 0.45;
/// Each segment bends towards +y by this times the sine of its angle to +y: tropism, chapter 2 of the book. Tuned by eye.
const TROPISM: f64 = 0.14;
/// Exponent of Leonardo's rule: a branch's radius to this power is the sum over those that it bears. He has 2; measured trees lie
/// between that and 3.
const AREA_EXPONENT: f64 = 2.2;
/// The trunk spreads at its foot by this much, and the tip of a twig has this share of its radius.
const FOOT: f64 = 1.5;
const TIP: f64 = 0.4;

pub fn tree() -> Mesh {
    let branches = grown(SEED, GENERATIONS);
    let height = branches.iter().flat_map(|b| &b.points).map(|p| p.y).fold(0.0, f64::max);
    let factor = HEIGHT / height;
    let all = branches.len() as f64;
    scaled(merged(branches.iter().map(|branch| branch.limb(RADIUS / factor, all))), factor)
}

fn grown(seed: u32, generations: usize) -> Vec<Branch> {
    let mut dice = Dice::new(seed);
    let angle = ANGLE_DEG.to_radians();
    let grow = |modules: Vec<Module>, _| rewritten(&modules, angle, &mut dice);
    branches(&(0..generations).fold(AXIOM.to_vec(), grow))
}

/// The only rule: an apex becomes a segment, a branch with an apex of its own, and an apex that goes on.
fn rewritten(modules: &[Module], angle: f64, dice: &mut Dice) -> Vec<Module> {
    let mut after = Vec::with_capacity(2 * modules.len());
    for module in modules {
        let Module::Apex { length } = *module else {
            after.push(*module);
            continue;
        };
        let angle_rad = angle * dice.between(0.75, 1.25);
        after.extend([
            Module::Segment { length: length * dice.between(0.8, 1.2) },
            Module::Push,
            Module::Turn(angle_rad),
            Module::Apex { length: length * SIDE },
            Module::Pop,
            Module::Turn(-RECOIL * angle_rad),
            Module::Roll((DIVERGENCE_DEG + dice.between(-25.0, 25.0)).to_radians()),
            Module::Apex { length: length * LEADING },
        ]);
    }
    after
}

/// A branch from where it starts to its tip.
struct Branch {
    points: Vec<DVec3>,
    /// Twigs that each point bears.
    twigs: Vec<f64>,
    /// The branch and the point of it that this one starts from.
    bearer: Option<(usize, usize)>,
}

impl Branch {
    fn new(start: DVec3, bearer: Option<(usize, usize)>) -> Branch {
        Branch { points: vec![start], twigs: Vec::new(), bearer }
    }

    /// A tapered tube; `trunk` is the radius of a branch that bears `all` twigs.
    fn limb(&self, trunk: f64, all: f64) -> Mesh {
        let radius = |twigs: &f64| trunk * (twigs / all).powf(1.0 / AREA_EXPONENT);
        let mut radii: Vec<f64> = self.twigs.iter().map(radius).collect();
        if self.bearer.is_none() {
            radii[0] *= FOOT;
        }
        radii[self.points.len() - 1] *= TIP;
        // Three for a twig, and one for each doubling of the twigs.
        let sides = 3 + self.twigs[0].log2() as usize;
        tube(&self.points, &radii, sides, false)
    }
}

/// The branches that a turtle draws, each after the one that bears it.
fn branches(modules: &[Module]) -> Vec<Branch> {
    let mut branches = vec![Branch::new(DVec3::ZERO, None)];
    let (mut place, mut frame, mut current) = (DVec3::ZERO, DQuat::IDENTITY, 0);
    let mut stack = Vec::new();
    for module in modules {
        match *module {
            Module::Turn(angle) => frame *= DQuat::from_rotation_x(angle),
            Module::Roll(angle) => frame *= DQuat::from_rotation_y(angle),
            Module::Segment { length } | Module::Apex { length } => {
                frame = lifted(frame);
                place += length * (frame * DVec3::Y);
                branches[current].points.push(place);
            }
            Module::Push => {
                stack.push((place, frame, current));
                let bearer = (current, branches[current].points.len() - 1);
                current = branches.len();
                branches.push(Branch::new(place, Some(bearer)));
            }
            Module::Pop => (place, frame, current) = stack.pop().expect("a branch was started"),
        }
    }
    count_twigs(&mut branches);
    branches
}

/// The heading, +y of the frame, turned towards the sky.
fn lifted(frame: DQuat) -> DQuat {
    let across = (frame * DVec3::Y).cross(DVec3::Y);
    DQuat::from_scaled_axis(TROPISM * across) * frame
}

/// A branch's tip is a twig, and each of its points bears what starts from it and from later ones.
fn count_twigs(branches: &mut [Branch]) {
    for branch in branches.iter_mut() {
        branch.twigs = vec![0.0; branch.points.len()];
    }
    for i in (0..branches.len()).rev() {
        let twigs = &mut branches[i].twigs;
        let mut sum = 1.0;
        for count in twigs.iter_mut().rev() {
            sum += *count;
            *count = sum;
        }
        if let Some((bearer, point)) = branches[i].bearer {
            branches[bearer].twigs[point] += sum;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn branches_start_on_their_bearers_and_grow_thinner() {
        let branches = grown(1, 8);
        assert_eq!(branches[0].twigs[0], branches.len() as f64);
        for branch in &branches {
            assert!(branch.twigs.is_sorted_by(|a, b| a >= b) && branch.twigs.last() == Some(&1.0));
            if let Some((bearer, point)) = branch.bearer {
                assert_eq!(branch.points[0], branches[bearer].points[point]);
                assert!(branch.twigs[0] < branches[bearer].twigs[point]);
            }
        }
    }

    #[test]
    fn it_stands_on_the_floor_at_its_height_with_tens_of_thousands_of_triangles() {
        let mesh = tree();
        assert!((20_000..60_000).contains(&mesh.triangle_count()), "{}", mesh.triangle_count());
        let bounds = mesh.bounds();
        assert!(bounds.min.y.abs() < 1e-6 && (bounds.max.y - HEIGHT).abs() < 0.05, "{bounds:?}");
        let [x, _, z] = bounds.size().to_array();
        assert!(
            (0.5..1.5).contains(&(x / HEIGHT)) && (0.5..1.5).contains(&(z / HEIGHT)),
            "{bounds:?}"
        );
    }
}
