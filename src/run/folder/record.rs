//! What a store tells of how its run was made.

use crate::io::store::StoreHeader;
use toml::{Table, Value};

/// The `run.toml` that a store carries. What is not there, or not as expected, has its default: a record written by
/// another version keeps no field from being drawn.
pub(crate) struct Record {
    case: Table,
    /// Whether another program measured the fields.
    is_foreign: bool,
}

impl Record {
    pub fn of(header: &StoreHeader) -> Self {
        // Tables of quadrille have the coefficients of its own field.
        let is_foreign = header.imported_from().is_some_and(|program| program != "quadrille");
        Self { case: header.case.parse().unwrap_or_default(), is_foreign }
    }

    /// Whether a regularisation, splines or subsets that overlap bind the nodes to each other: standard uncertainties of
    /// what is drawn from them are then upper bounds.
    pub fn is_regularised(&self) -> bool {
        let section = self.case.get("correlation");
        let is = |key: &str, usual: &str| {
            section.and_then(|section| section.get(key)).is_some_and(|kind| kind.as_str() != Some(usual))
        };
        self.is_foreign || is("regularisation", "none") || is("elements", "bilinear")
    }

    /// Page of the reference.
    pub fn page(&self) -> usize {
        let page = self.case.get("images").and_then(|images| images.get("page")).and_then(Value::as_integer);
        page.and_then(|page| usize::try_from(page).ok()).unwrap_or(0)
    }

    /// The guard of each of the zones `names` of the mesh, px: where it is the same along the whole border, else 0.
    ///
    /// By name: a section `[[zone]]` with a mesh file is as many zones as the file has groups. They are named by the
    /// file, behind the name of the section when it has one.
    #[cfg(feature = "cli")]
    pub fn guards_px(&self, names: &[String]) -> Vec<f64> {
        let sections: Vec<&Value> = self.case.get("zone").and_then(Value::as_array).into_iter().flatten().collect();
        let text = |section: &Value, key: &str| section.get(key).and_then(Value::as_str).map(str::to_owned);
        let of_section = |name: &str| {
            let named = |section: &&&Value| {
                let own = text(section, "name").or_else(|| text(section, "group"));
                own.is_some_and(|own| own == name || name.strip_prefix(&own).is_some_and(|rest| rest.starts_with(' ')))
            };
            let unnamed = |section: &&&Value| text(section, "name").or_else(|| text(section, "group")).is_none();
            sections.iter().find(named).or_else(|| sections.iter().find(unnamed)).copied()
        };
        let number = |value: &Value| value.as_float().or(value.as_integer().map(|v| v as f64));
        let guard = |name: &String| of_section(name).and_then(|section| section.get("guard_px")).and_then(number);
        names.iter().map(|name| guard(name).unwrap_or(0.0)).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn guards(record: &str, names: &[&str]) -> Vec<f64> {
        let case = record.parse().unwrap();
        Record { case, is_foreign: false }.guards_px(&names.iter().map(|name| name.to_string()).collect::<Vec<_>>())
    }

    #[test]
    fn the_groups_of_a_mesh_file_share_the_guard_of_its_section() {
        let record = "[[zone]]\nname = 'left'\nguard_px = 2\n[[zone]]\nmesh = 'a.msh'\nguard_px = 3.5\n\
                      [[zone]]\nname = 'right'\nguard_px = 4.0";
        assert_eq!(guards(record, &["left", "A", "B", "right"]), [2.0, 3.5, 3.5, 4.0]);
        let record = "[[zone]]\nname = 'plate'\nmesh = 'a.msh'\nguard_px = 3\n[[zone]]\nname = 'plates'";
        assert_eq!(guards(record, &["plate A", "plate B", "plates"]), [3.0, 3.0, 0.0]);
        let record = "[[zone]]\ngroup = 'B'\nmesh = 'a.msh'\nguard_px = 3\n[[zone]]\nname = 'C'\nguard_px = [1, 2]";
        assert_eq!(guards(record, &["B", "C"]), [3.0, 0.0]);
        assert_eq!(guards("", &["all"]), [0.0]);
    }
}
