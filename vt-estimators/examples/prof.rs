#![allow(missing_docs)]
use std::time::Instant;
use vt_core::nalgebra::Vector6;
use vt_core::batch::*;
use vt_core::manifold::*;
use vt_core::belief::*;
use vt_core::lie::*;
use vt_core::dynamics::*;
use vt_core::agent::*;
use vt_core::time::Seconds;
use vt_core::random::*;
fn t(name:&str, mut f: impl FnMut()) { let mut v=vec![]; for _ in 0..15 { let b=Instant::now(); for _ in 0..20 {f();} v.push(b.elapsed().as_secs_f64()*1e6/20.0);} v.sort_by(f64::total_cmp); println!("{name}: {:.2} us", v[7]); }
fn main(){
 let s=SE3::from_rotation_vector(&[0.3,-0.2,0.5].into(),[0.1,0.0,0.8].into());
 let m=Moving{pose:s,velocity:Vector6::new(0.01,0.02,0.0,0.01,0.03,0.02)};
 let mut states=vec![m.clone();1000];
 let spare=states.clone();
 let mut poses=vec![s;1000];
 let src=Source::new(0,Stream::Predict,0);
 let mut rows=vec![[0.0;LANES];12];
 t("normals", || for c in 0..16 { src.normal_rows(3,c*64,&mut rows); std::hint::black_box(&rows);} );
 let small: Vec<Row>=rows.iter().map(|r| r.map(|x| x*0.01)).collect();
 t("retract_each", || for c in states.chunks_mut(64) { Moving::<SE3>::retract_each(c,|s| s,&small); });
 states.clone_from(&spare);
 let cv=ConstantVelocity::<SE3>::new(Vector6::repeat(0.01)).unwrap();
 t("propagate_each", || for c in states.chunks_mut(64) { cv.propagate_each(c,Seconds(0.03)); });
 states.clone_from(&spare);
 t("noise_root", || { std::hint::black_box(cv.noise_root(&m,Seconds(0.03))); });
 t("clone", || { states.clone_from(&spare); std::hint::black_box(&states); });
 t("gather", || { states.clear(); states.extend((0..1000).map(|k| spare[k].clone())); std::hint::black_box(&states); });
 t("poses", || { poses.clear(); poses.extend(states.iter().map(|s| *State::<SE3>::pose(s))); std::hint::black_box(&poses); });
 t("finite", || { std::hint::black_box(states.iter().all(|s| s.is_finite())); });
 t("local_each", || for c in poses.chunks(64) { s.local_each(c,&mut rows); std::hint::black_box(&rows); });
 t("dots", || for _ in 0..16 { let w=[0.5;LANES]; let mut o=[[0.0;6];6]; vectorized(#[inline(always)] || for r in 0..6 { let mut ww=w; ww.iter_mut().zip(&rows[r]).for_each(|(a,b)| *a*=b); for c in 0..=r { o[r][c]=dot(&ww,&rows[c]); } }); std::hint::black_box(&o); });
 let mut e=vec![-0.3;1000];
 t("exp", || { vt_core::math::exp_all(&mut e); e.fill(-0.3); });
}
