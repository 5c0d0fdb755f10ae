// SPDX-License-Identifier: Apache-2.0
#include "hw/rig/rig_tuning.h"

#include "common/base/member_count.h"

namespace cairn {
namespace {

constexpr OptionList::Range kShare = {0, 1};
constexpr OptionList::Range kAngle = {0, std::numbers::pi};
constexpr OptionList::Range kSeconds = {1e-3, 60};

OptionList list_options(AxisOptions* o) {
  OptionList list(member_count<AxisOptions>());
  list.add("homing_time", &o->homing_time, {1000, 600'000}, "ms");
  list.add("rate_headroom", &o->rate_headroom, {1, 2}, "of the rate limit");
  list.add("runaway_rate", &o->runaway_rate, {1, 3}, "of the rate limit");
  list.add_order("rate_headroom", "runaway_rate");
  list.add("jump", &o->jump, {1e-3, 0.2}, "rad");
  list.add("jump_rate", &o->jump_rate, {1, 10}, "of the rate limit");
  return list;
}

OptionList list_options(StallOptions* o) {
  OptionList list(member_count<StallOptions>());
  list.add("window", &o->window, {0.02, 0.5}, "s");
  list.add("told", &o->told, {1e-4, 0.1}, "rad");
  list.add("still", &o->still, {0.01, 0.9}, "of the way of the setpoints");
  list.add("still_for", &o->still_for, {0.01, 0.5}, "s");
  list.add("still_periods", &o->still_periods, {1, 20}, "periods");
  list.add("far_behind", &o->far_behind, {1e-3, 0.5}, "rad");
  list.add("behind_for", &o->behind_for, {0.01, 1}, "s");
  return list;
}

OptionList list_options(RigTimingOptions* o) {
  OptionList list(member_count<RigTimingOptions>());
  list.add("in_step", &o->in_step, {0, 0.5}, "of a sample");
  list.add("behind_sample", &o->behind_sample, {0, 0.02}, "s");
  list.add("step_share", &o->step_share, {0, 0.5}, "of a period");
  list.add("most_periods", &o->most_periods, {1, 20}, "periods");
  list.add("imu_rate_off", &o->imu_rate_off, {1e-3, 0.5}, "of the rate");
  return list;
}

OptionList list_options(AttitudeOptions* o) {
  OptionList list(member_count<AttitudeOptions>());
  list.add("trusted", &o->trusted, kShare, "of gravity");
  list.add("uprighting", &o->uprighting, {0, 10}, "1/s");
  list.add("bias_learning", &o->bias_learning, {0, 10}, "1/s^2");
  list.add("first", &o->first, kSeconds, "s");
  list.add("rest", &o->rest, {0.1, 60}, "s");
  list.add("rest_off", &o->rest_off, kAngle, "rad");
  list.add("highest_bias", &o->highest_bias, {0, 1}, "rad/s");
  list.add("most_rests", &o->most_rests, {1, 1e6}, "rests");
  return list;
}

OptionList list_options(BaseOptions* o) {
  OptionList list(member_count<BaseOptions>());
  list.add("smoothing", &o->smoothing, kSeconds, "s");
  list.add("sway_forgotten", &o->sway_forgotten, kSeconds, "s");
  return list;
}

OptionList list_options(BacklashOptions* o) {
  OptionList list(member_count<BacklashOptions>());
  list.add("noise", &o->noise, {0, 10}, "rad/s");
  list.add("crossing", &o->crossing, kSeconds, "s");
  return list;
}

OptionList list_options(TargetTrackOptions* o) {
  OptionList list(member_count<TargetTrackOptions>());
  list.add("forgotten", &o->forgotten, kSeconds, "s");
  list.add("fold_time", &o->fold_time, kSeconds, "s");
  list.add("speed_time", &o->speed_time, kSeconds, "s");
  return list;
}

OptionList list_options(SearchPlanOptions* o) {
  OptionList list(member_count<SearchPlanOptions>());
  list.add("view_step", &o->view_step, {0.05, 1}, "of a view");
  list.add("least_step", &o->least_step, {0.02, 1.5}, "rad");
  return list;
}

OptionList list_options(PointerOptions* o) {
  OptionList list(member_count<PointerOptions>());
  list.add("following", &o->following, kSeconds, "s");
  list.add("on_target", &o->on_target, kAngle, "rad");
  list.add("settling", &o->settling, {0, 60}, "s");
  list.add("glance", &o->glance, {0, 60}, "s");
  list.add("share_of_view", &o->share_of_view, kShare, "of a view");
  list.add("patience", &o->patience, kSeconds, "s");
  list.add("remembered", &o->remembered, {0, 3.6e6}, "ms");
  list.add("on_the_wire", &o->on_the_wire, {0, 0.1}, "s");
  list.add("of_sample", &o->of_sample, {0, 0.1}, "s");
  list.add_order("of_sample", "on_the_wire");
  list.add("gap", &o->gap, {1, 60'000}, "ms");
  list.add("furthest", &o->furthest, {0, 1}, "s");
  return list;
}

}  // namespace

OptionList list_options(RigTuning* o) {
  OptionList list(member_count<RigTuning>());
  list.add_part("axis", list_options(&o->axis));
  list.add_part("stall", list_options(&o->stall));
  list.add_part("timing", list_options(&o->timing));
  list.add_part("attitude", list_options(&o->attitude));
  list.add_part("base", list_options(&o->base));
  list.add_part("backlash", list_options(&o->backlash));
  list.add_part("target", list_options(&o->target));
  list.add_part("search", list_options(&o->search));
  list.add_part("pointer", list_options(&o->pointer));
  return list;
}

}  // namespace cairn
