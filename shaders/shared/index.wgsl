// Number of a workgroup in a dispatch that is folded into rows (a dimension holds 65535 at most).
fn group_number(group: vec3<u32>, groups: vec3<u32>) -> u32 {
    return group.y * groups.x + group.x;
}
