//! What there is to say of a joint before it is computed.

use crate::remark::{About, Code, Remark};

/// The rigid motion that is taken off turns by up to `rotation_rad`, which changes the sliding jump of a `gap`.
pub(super) fn rigid_motion_removed(rotation_rad: f64, gap_mm: f64) -> Remark {
    let change_mm = rotation_rad * gap_mm;
    let text = format!(
        "the overall rigid motion is taken off (rotation up to {rotation_rad:.2e} rad); with kinematics = \"paper\" \
         this changes the sliding jump by up to {change_mm:.2e} mm"
    );
    let remark = Remark::new(Code::RigidMotionRemoved, About::Joint, text);
    remark.with("rotation_rad", rotation_rad).with("sliding_mm", change_mm)
}

pub(super) fn elements_apart(size_mm: f64, opening_mm: f64) -> Remark {
    let text = format!(
        "elements of {size_mm:.3e} mm beside a joint that is open at {opening_mm:.3e} mm: are all lengths in mm?"
    );
    let remark = Remark::new(Code::LengthsApart, About::Joint, text);
    remark.with("element_mm", size_mm).with("opening_mm", opening_mm)
}

pub(super) fn border_apart(moves_mm: f64, extent_mm: f64) -> Remark {
    let text = format!(
        "the border moves by up to {moves_mm:.3e} mm, more than the joint's size of {extent_mm:.3e} mm: are all \
         lengths in mm?"
    );
    Remark::new(Code::LengthsApart, About::Joint, text).with("moves_mm", moves_mm).with("extent_mm", extent_mm)
}

/// The nodes `free` of the outer border are not prescribed; `None` where all are.
pub(super) fn border_free(free: &[u32]) -> Option<Remark> {
    let first = free.first()?;
    let text = format!(
        "{} nodes of the outer border are not prescribed and left free (the first is node {first}); measured \
         displacements of the whole border, end nodes of the adhesive's faces included, determine the joint better",
        free.len()
    );
    let nodes = free.iter().map(|&node| node as usize).collect();
    Some(Remark::new(Code::BorderFree, About::Nodes(nodes), text).with("nodes", free.len()))
}

/// Nodes of the border of a body that some frame has lost; `None` where there are none.
pub(super) fn border_lost(lost: &[u32]) -> Option<Remark> {
    let first = lost.first()?;
    let text = format!(
        "{} nodes of the border are lost in some frame and left free, as if no force acted there (the first is node {first})",
        lost.len()
    );
    let nodes = lost.iter().map(|&node| node as usize).collect();
    Some(Remark::new(Code::BorderFree, About::Nodes(nodes), text).with("nodes", lost.len()))
}

/// The frames `left_out` did not converge; `None` where all did.
pub(super) fn frames_left_out(left_out: &[usize]) -> Option<Remark> {
    let numbers: Vec<String> = left_out.iter().map(usize::to_string).collect();
    let text =
        format!("frames {} did not converge and are left out; instants are counted without them", numbers.join(", "));
    let about = About::Frames(left_out.to_vec());
    (!left_out.is_empty()).then(|| Remark::new(Code::FramesLeftOut, about, text).with("frames", left_out.len()))
}
