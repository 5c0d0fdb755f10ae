// SPDX-License-Identifier: Apache-2.0
#include "client/tracking/tracker_options.h"

#include <gtest/gtest.h>

#include <functional>
#include <set>
#include <string>

#include "common/base/option_yaml.h"

namespace cairn {
namespace {

using Visit = std::function<void(const std::string&, const OptionList::Row&)>;

void for_each_row(const OptionList& list, const std::string& prefix, const Visit& visit) {
  for (const OptionList::Row& row : list.rows()) visit(prefix + row.name, row);
  for (const auto& [name, part] : list.parts()) for_each_row(part, prefix + name + ".", visit);
}

const void* address(const OptionList::Row& row) {
  return std::visit([](const auto* value) { return static_cast<const void*>(value); }, row.value);
}

TEST(TrackerOptionsTest, DefaultsAreInTheirRanges) {
  const Status checked = check_options(TrackerOptions());
  EXPECT_TRUE(checked) << checked.error().message;
}

TEST(TrackerOptionsTest, EachNameIsAMemberOfItsOwn) {
  TrackerOptions options;
  const auto* begin = reinterpret_cast<const char*>(&options);
  std::set<const void*> addresses;
  std::set<std::string> names;
  for_each_row(list_options(&options), "", [&](const std::string& name, const OptionList::Row& row) {
    EXPECT_TRUE(addresses.insert(address(row)).second) << name << " is another's member";
    EXPECT_TRUE(names.insert(name).second) << name << " is there twice";
    const auto* at = static_cast<const char*>(address(row));
    EXPECT_TRUE(at >= begin && at < begin + sizeof(options)) << name;
    EXPECT_LE(row.range.least, row.range.most) << name;
  });
  EXPECT_GT(names.size(), 170U);
}

TEST(TrackerOptionsTest, EachMemberIsListedOnce) {
  TrackerOptions options;
  const Status complete = list_options(&options).check_complete();
  EXPECT_TRUE(complete) << complete.error().message;
}

/// Whatever the values are, to the bit.
TEST(TrackerOptionsTest, WhatIsPrintedIsReadAsTheSame) {
  TrackerOptions options;
  for_each_row(list_options(&options), "", [](const std::string&, const OptionList::Row& row) {
    if (auto* const* number = std::get_if<float*>(&row.value)) **number *= 1 - 1.0F / 3000;
    if (auto* const* number = std::get_if<double*>(&row.value)) **number *= 1 - 1.0 / 3000;
  });
  const std::string text = write_options(list_options(&options));
  TrackerOptions again;
  const Status read = read_options(YAML::Load(text), "printed", list_options(&again));
  ASSERT_TRUE(read) << read.error().message;
  EXPECT_EQ(write_options(list_options(&again)), text);
  EXPECT_EQ(again.motion.shortest_step, options.motion.shortest_step);
  EXPECT_NE(again.motion.shortest_step, MotionOptions().shortest_step);
}

/// The shares that a pose is judged by are limits of each other.
TEST(TrackerOptionsTest, WhatContradictsItselfIsRefused) {
  TrackerOptions options;
  options.lost_quality = options.recovery.verified_quality + 0.01F;
  options.good_quality = 1;
  EXPECT_FALSE(check_options(options));
  options = {};
  options.provisional.finest_level = options.provisional.coarsest_level + 1;
  EXPECT_FALSE(check_options(options));
}

}  // namespace
}  // namespace cairn
