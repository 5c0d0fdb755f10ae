// SPDX-License-Identifier: Apache-2.0
#include "common/base/option_list.h"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <limits>

#include "common/base/member_count.h"
#include "common/base/option_yaml.h"

namespace cairn {
namespace {

using std::chrono::milliseconds;

struct LensOptions {
  float radius = 0.3F;
  double cutoff = 1.0 / 240;
  bool is_round = true;
};

struct EyeOptions {
  int blinks = 3;
  int most_blinks = 30;
  uint64_t seed = std::numeric_limits<uint64_t>::max();
  milliseconds patience{300};
  LensOptions lens;
};

OptionList list_options(LensOptions* o) {
  OptionList list(member_count<LensOptions>());
  list.add("radius", &o->radius, {0, 1}, "px");
  list.add("cutoff", &o->cutoff, {0, 1}, "s");
  list.add("is_round", &o->is_round);
  return list;
}

OptionList list_options(EyeOptions* o) {
  OptionList list(member_count<EyeOptions>());
  list.add("blinks", &o->blinks, {0, 100});
  list.add("most_blinks", &o->most_blinks, {0, 100});
  list.add_order("blinks", "most_blinks");
  list.add("seed", &o->seed, {0, 1.9e19});
  list.add("patience", &o->patience, {1, 1000}, "ms");
  list.add_part("lens", list_options(&o->lens));
  return list;
}

Status read(const std::string& text, EyeOptions* options) {
  return read_options(YAML::Load(text), "eye.yaml", list_options(options));
}

std::string complaint_about(const std::string& text) {
  EyeOptions options;
  const Status done = read(text, &options);
  return done ? "" : done.error().message;
}

TEST(OptionList, WhatIsWrittenIsReadAsTheSameValues) {
  EyeOptions unusual{7, 8, 12345678901234567890ULL, milliseconds(17), {0.1F + 0.2F, 1.0 / 3 + 1e-16, false}};
  const std::string text = write_options(list_options(&unusual));
  EyeOptions again;
  ASSERT_TRUE(read(text, &again));
  EXPECT_EQ(again.blinks, unusual.blinks);
  EXPECT_EQ(again.seed, unusual.seed);
  EXPECT_EQ(again.patience, unusual.patience);
  EXPECT_EQ(again.lens.radius, unusual.lens.radius) << "to the bit";
  EXPECT_EQ(again.lens.cutoff, unusual.lens.cutoff);
  EXPECT_EQ(again.lens.is_round, unusual.lens.is_round);
  EXPECT_EQ(write_options(list_options(&again)), text);
}

TEST(OptionList, TheEndsOfARangeAreInItAsTheOptionsTypeHasThem) {
  for (const double end : {0.01, 0.1, 0.3, 0.7, 0.9}) {
    const auto nearest = static_cast<float>(end);
    float value = nearest;
    const OptionList list = OptionList().add("ratio", &value, {end, end});
    EXPECT_TRUE(list.check()) << end;
    for (const float beside : {0.0F, 1.0F}) {
      value = std::nextafter(nearest, beside);
      EXPECT_FALSE(list.check()) << end;
    }
  }
}

TEST(OptionList, WhatIsNotNamedKeepsItsValue) {
  EyeOptions options;
  options.blinks = 11;
  ASSERT_TRUE(read("lens:\n  radius: 0.5\n", &options));
  EXPECT_EQ(options.blinks, 11);
  EXPECT_EQ(options.lens.radius, 0.5F);
  EXPECT_EQ(options.lens.cutoff, LensOptions().cutoff);
  EXPECT_TRUE(read("", &options)) << "an empty file";
}

TEST(OptionList, RefusesWhatItDoesNotKnowAndNamesTheNearest) {
  EXPECT_EQ(complaint_about("blinks: 4\nlens:\n  radios: 0.5\n"),
            "eye.yaml:3: unknown key 'radios'; did you mean radius?");
  EXPECT_EQ(complaint_about("lense: {}\n"), "eye.yaml:1: unknown key 'lense'; did you mean lens?");
  EXPECT_EQ(complaint_about("blinks: 4\nblinks: 4\n"), "eye.yaml:2: 'blinks' is there twice");
}

TEST(OptionList, RefusesWhatIsNoNumberOfItsKind) {
  EXPECT_EQ(complaint_about("blinks: 4.5\n"), "eye.yaml:1: blinks '4.5': expected a whole number");
  EXPECT_EQ(complaint_about("lens:\n  cutoff: 1 s\n"), "eye.yaml:2: cutoff '1 s': expected a number");
  EXPECT_EQ(complaint_about("lens:\n  is_round: 1\n"), "eye.yaml:2: is_round '1': expected true or false");
  EXPECT_NE(complaint_about("seed: -1\n"), "");
  EXPECT_NE(complaint_about("blinks: [4]\n"), "");
  EXPECT_NE(complaint_about("lens: 4\n"), "");
  EXPECT_NE(complaint_about("- blinks\n"), "");
}

TEST(OptionList, RefusesWhatIsOutOfItsRange) {
  EXPECT_TRUE(check_options(EyeOptions()));
  EXPECT_EQ(complaint_about("patience: 0\n"), "eye.yaml:1: patience is 0: expected 1 to 1000 [ms]");
  EXPECT_EQ(complaint_about("blinks: 40\n"), "eye.yaml:1: blinks is 40, more than most_blinks, which is 30");
  EyeOptions options;
  options.lens.radius = std::numeric_limits<float>::quiet_NaN();
  const Status checked = check_options(options);
  ASSERT_FALSE(checked);
  EXPECT_EQ(checked.error().message, "lens.radius is nan: expected 0 to 1 [px]");
  EXPECT_EQ(checked.error().code, ErrorCode::kConfiguration);
}

TEST(MemberCount, CountsWhatBracesTake) {
  struct Empty {};
  struct Nested {
    EyeOptions eye;
    std::array<double, 3> radii{};
    milliseconds wait{};
    bool is_on = false;
  };
  static_assert(member_count<Empty>() == 0);
  static_assert(member_count<LensOptions>() == 3);
  static_assert(member_count<EyeOptions>() == 5);
  static_assert(member_count<Nested>() == 4);
}

TEST(OptionList, AMemberThatIsNotListedIsFound) {
  EyeOptions eye;
  EXPECT_TRUE(list_options(&eye).check_complete());
  OptionList lacking(member_count<LensOptions>());
  lacking.add("radius", &eye.lens.radius, {0, 1}).add("is_round", &eye.lens.is_round);
  ASSERT_FALSE(lacking.check_complete());
  EXPECT_EQ(OptionList().add_part("lens", lacking).check_complete().error().message,
            "lens: 2 options and parts are listed, the struct has 3");
  lacking.add("cutoff", &eye.lens.radius, {0, 1});
  EXPECT_FALSE(lacking.check_complete()) << "twice the same";
  EXPECT_FALSE(
      OptionList().add_part("lens", OptionList().add("radius", &eye.lens.radius, {0, 1})).check_complete())
      << "nobody has counted";
}

}  // namespace
}  // namespace cairn
