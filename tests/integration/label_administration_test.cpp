// SPDX-License-Identifier: Apache-2.0
// Labels under the eyes of an operator: `cairnctl labels` as a process, against a server that people label
// on.
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <sys/wait.h>

#include <array>
#include <cstdio>
#include <nlohmann/json.hpp>

#include "tests/integration/label_fixture.h"

namespace cairn {
namespace {

using nlohmann::json;
using ::testing::AllOf;
using testing::eventually;
using ::testing::HasSubstr;
using ::testing::StartsWith;

struct Said {
  int exit = -1;
  std::string text;  ///< both streams
};

class LabelAdministrationTest : public testing::LabelFixture {
 protected:
  Said cairnctl(const std::string& words) const {
    const std::string line = std::string(CAIRNCTL_PROGRAM) + " --domain " +
                             std::to_string(service_options_.domain) + " " + words + " 2>&1";
    FILE* pipe = popen(line.c_str(), "r");
    if (pipe == nullptr) return {};
    Said said;
    std::array<char, 4096> buffer{};
    for (size_t n = 0; (n = fread(buffer.data(), 1, buffer.size(), pipe)) > 0;)
      said.text.append(buffer.data(), n);
    const int status = pclose(pipe);
    said.exit = WIFEXITED(status) ? WEXITSTATUS(status) : -1;
    return said;
  }
  json list(const std::string& words = "labels map-1") const {
    const Said said = cairnctl("--json " + words);
    EXPECT_EQ(said.exit, 0) << said.text;
    return json::parse(said.text, nullptr, false);
  }
};

TEST_F(LabelAdministrationTest, ListsWhatPeopleHaveSaidAndWhere) {
  make_map();
  EXPECT_EQ(list(), json::array());
  const LabelId vice = add(*anna_, "vice");
  (void)add(*anna_, "drill");
  const json labels = list();
  ASSERT_EQ(labels.size(), 2U);
  EXPECT_EQ(labels[0]["id"], vice.value);
  EXPECT_EQ(labels[0]["text"], "vice");
  EXPECT_EQ(labels[0]["author"], "anna");
  EXPECT_EQ(labels[0]["map"], "map-1");
  EXPECT_EQ(labels[1]["text"], "drill");
  const auto at = labels[0]["position"].get<std::vector<double>>();
  const SE3& camera_from_map = anna_->snapshot()->find(KeyframeId{2})->camera_from_map;
  EXPECT_LT((camera_from_map * Eigen::Vector3d(at.at(0), at.at(1), at.at(2)) - kSeen).norm(), 1e-3);
  EXPECT_EQ(list("labels"), labels) << "of all maps";
  EXPECT_EQ(list("labels map-1 list"), labels);
  EXPECT_EQ(list("labels " + to_hex(map_.bytes)), labels) << "by id";
  const Said said = cairnctl("labels map-1");
  EXPECT_EQ(said.exit, 0);
  EXPECT_THAT(said.text,
              AllOf(StartsWith("map-1"), HasSubstr("vice"), HasSubstr("by anna"), HasSubstr(" UTC, at ")));
}

TEST_F(LabelAdministrationTest, MoreThanFitIntoOneAnswerAreListedWhole) {
  make_map();
  const std::string longest(kMaxLabelBytes, 'x');
  const size_t count = 200;
  for (size_t i = 0; i < count; ++i) (void)add(*anna_, longest);
  EXPECT_EQ(list().size(), count);
}

TEST_F(LabelAdministrationTest, SoAreMoreMapsThanFit) {
  const uint16_t count = 700;
  for (uint16_t i = 1; i <= count; ++i) {
    auto map = std::make_shared<MapSnapshot>();
    map->map.bytes = {static_cast<uint8_t>(i >> 8), static_cast<uint8_t>(i)};
    map->name = "made-elsewhere-" + std::to_string(i);
    service_->publish(map);
  }
  ASSERT_TRUE(eventually([&] { return service_->maps().size() == count; }));
  const json listed = list("maps");
  ASSERT_EQ(listed["maps"].size(), count);
  for (uint16_t i = 1; i <= count; ++i)
    EXPECT_EQ(listed["maps"][i - 1]["name"], "made-elsewhere-" + std::to_string(i));
  EXPECT_TRUE(listed["deleted"].empty());
}

TEST_F(LabelAdministrationTest, WhatAnOperatorChangesAllSeeAndTheStoreKeeps) {
  make_map();
  const LabelId vice = add(*anna_, "vise");
  const LabelId rude = add(*anna_, "rude");
  Said said = cairnctl("labels map-1 rename " + std::to_string(vice.value) + " 'small vice'");
  EXPECT_EQ(said.exit, 0) << said.text;
  EXPECT_THAT(said.text, HasSubstr("small vice"));
  EXPECT_TRUE(eventually([&] { return texts(*anna_) == Texts{"small vice", "rude"}; }));
  said = cairnctl("labels map-1 remove " + std::to_string(rude.value) + " </dev/null");
  EXPECT_EQ(said.exit, 2) << "nobody can be asked: " << said.text;
  EXPECT_THAT(said.text, HasSubstr("give the command with --yes"));
  EXPECT_EQ(texts(*anna_).size(), 2U);
  said = cairnctl("labels map-1 remove --yes " + std::to_string(rude.value));
  EXPECT_EQ(said.exit, 0) << said.text;
  EXPECT_EQ(said.text, "label " + std::to_string(rude.value) + " of map-1 removed: rude\n");
  EXPECT_TRUE(eventually([&] { return texts(*anna_) == Texts{"small vice"}; }));

  service_.reset();
  start_service_again();
  const json labels = list();
  ASSERT_EQ(labels.size(), 1U);
  EXPECT_EQ(labels[0]["text"], "small vice");
  EXPECT_NE(labels[0]["author"], "anna") << "the operator's word now";
}

TEST_F(LabelAdministrationTest, WhatIsNotThereIsNamedWithTheRemedy) {
  make_map();
  const LabelId vice = add(*anna_, "vice");
  const std::string id = std::to_string(vice.value);
  struct Case {
    std::string words;
    int exit;
    std::vector<std::string> named;
  };
  for (const Case& c : std::vector<Case>{
           {"labels attic", 5, {"'attic'", "cairnctl maps"}},
           {"labels attic remove 1 --yes", 5, {"'attic'", "cairnctl maps"}},
           {"labels map-1 remove 77 --yes", 5, {"label 77", "'map-1'", "cairnctl labels map-1"}},
           {"labels map-1 rename 77 x", 5, {"label 77", "'map-1'", "cairnctl labels map-1"}},
           {"labels map-1 rename " + id + " ' '", 2, {"label " + id, "needs a text"}},
           {"labels map-1 rename " + id + " \"$(printf 'a\\nb')\"", 2, {"TEXT", "U+000A"}},
           {"labels remove 1", 2, {"of which map"}},
           {"labels map-1 remove vice", 2, {"vice"}}}) {
    const Said said = cairnctl(c.words);
    EXPECT_EQ(said.exit, c.exit) << c.words << ": " << said.text;
    for (const std::string& word : c.named) EXPECT_THAT(said.text, HasSubstr(word)) << c.words;
  }
  EXPECT_EQ(list()[0]["text"], "vice");
}

}  // namespace
}  // namespace cairn
