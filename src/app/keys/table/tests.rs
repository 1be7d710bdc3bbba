//! Tests of `table`.

use strum::VariantArray as _;

use super::*;
use crate::app::state::app_state::AppState;

#[test]
fn every_layer_has_its_key_in_order() {
    let state = AppState::default();
    let layers: Vec<_> = BINDINGS
        .iter()
        .filter_map(|binding| match binding.command(&state)? {
            Command::ShowLayer(layer) => Some(layer),
            _ => None,
        })
        .collect();
    assert_eq!(layers, Layer::VARIANTS);
}

#[test]
fn every_command_has_a_menu_and_a_name_of_its_own() {
    let commands: Vec<_> = BINDINGS.iter().filter(|b| b.is_command()).collect();
    for (i, binding) in commands.iter().enumerate() {
        let is_in = |(_, groups): &&(&str, &[&str])| groups.contains(&binding.group);
        assert_eq!(MENUS.iter().filter(is_in).count(), 1, "{binding:?}");
        let twin = commands[..i].iter().find(|b| b.what == binding.what);
        assert!(twin.is_none(), "{binding:?} twice");
    }
}

#[test]
fn every_key_of_a_command_is_one() {
    for binding in BINDINGS.iter().filter(|b| b.is_command()) {
        let written = binding.keys.split(", ").filter(|keys| !keys.is_empty());
        let plus = usize::from(binding.keys.ends_with('+'));
        assert_eq!(
            binding.shortcuts().count(),
            written.count() + plus,
            "{binding:?}"
        );
    }
}

/// The section of `docs/window.md` between the two marks is this table and nothing else.
#[test]
fn the_manual_lists_these_keys() {
    let manual = include_str!("../../../../docs/window.md").replace("\r\n", "\n");
    let mut table = String::from("| | keys and mouse | |\n|---|---|---|\n");
    for binding in BINDINGS.iter().filter(|binding| !binding.keys.is_empty()) {
        let Binding {
            group, keys, what, ..
        } = binding;
        table.extend(["| ", group, " | ", keys, " | ", what, " |\n"]);
    }
    let listed = manual
        .split_once("<!-- keys -->\n")
        .and_then(|(_, rest)| rest.split_once("<!-- /keys -->"));
    assert!(
        listed.is_some_and(|(listed, _)| listed == table),
        "put this into docs/window.md between <!-- keys --> and <!-- /keys -->:\n{table}"
    );
}
