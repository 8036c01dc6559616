#!/bin/sh
# The compiler as CI calls it for the crates of this workspace (RUSTC_WORKSPACE_WRAPPER). What is only tests is not optimised as much: the unit
# tests of the library are a second build of all of it for tests that take seconds, and the test programs wait for what they call.
rustc=$1
shift
case " $* " in
*" --crate-name quadrille"*" --test "*) exec "$rustc" "$@" -C opt-level=0 ;;
*" --test "*) exec "$rustc" "$@" -C opt-level=1 ;;
esac
exec "$rustc" "$@"
