//! Broken input as users meet it: each case is a folder of good files with something wrong in it and a command that
//! must end with exit code 2 and an error that names the file, the place, what was expected and the nearest name.

#![cfg(target_os = "linux")]

mod arguments;
mod cameras;
mod images;
mod interrupted;
mod mesh_graphs;
mod meshes;
mod methods;
mod poses;
mod sequences;
mod support;
mod tasks;
