#!/bin/sh
# The compiler as CI calls it for the crates of this workspace (RUSTC_WORKSPACE_WRAPPER): the unit tests of the library are a second
# build of all of it for tests that take seconds, and are not optimised as much.
rustc=$1
shift
case " $* " in
*" --crate-name quadrille "*" --test "*) exec "$rustc" "$@" -C opt-level=1 ;;
esac
exec "$rustc" "$@"
