// SPDX-License-Identifier: Apache-2.0
#include "server/service/admin_reply.h"
#include "common/base/utf8.h"

#include <gtest/gtest.h>

#include <nlohmann/json.hpp>
#include <random>

#include "server/service/admin_json.h"
#include "server/service/health.h"

namespace cairn {
namespace {

constexpr unsigned kSeed = 7;

/// As a component tells them: all that there are beyond one.
told::Labels labels_beyond(const std::vector<Label>& labels, LabelId after) {
  told::Labels told;
  for (const Label& label : labels)
    if (label.id > after) told.labels.push_back({"desk", label});
  return told;
}

TEST(AdminReply, PagesOfLabelsAreWholeInOrderAndSmallEnoughForAStateSample) {
  std::mt19937 random(kSeed);
  std::vector<Label> labels;
  for (uint64_t id = 1; id <= kMaxLabels; ++id) {
    Label label;
    label.id = {3 * id};  // some have been removed
    // Some of them no UTF-8, which a reply writes longer than it is.
    const size_t length = random() % (kMaxLabelBytes + 1);
    label.text = std::string(length, random() % 4 == 0 ? '\xff' : 'x');
    label.author = "anna";
    label.map_from_label = SE3(Eigen::Quaterniond::Identity(), {0.1, -2.0 / 3, static_cast<double>(id)});
    labels.push_back(label);
  }
  std::vector<uint64_t> told;
  int pages = 0;
  for (bool more = true; more; ++pages) {
    ASSERT_LT(pages, 100) << "seed " << kSeed;
    const told::Labels asked = labels_beyond(labels, {told.empty() ? 0 : told.back()});
    EXPECT_LT(reply_of(asked).text.size(), size_t{64'000});
    const auto page = content_of(asked);
    for (const auto& label : page["labels"]) {
      EXPECT_EQ(label["map"], "desk");
      EXPECT_NEAR(label["position"][1], -2.0 / 3, 1e-12);
      told.push_back(label["id"]);
    }
    more = page["more"];
    ASSERT_TRUE(!more || !page["labels"].empty()) << "who asks on gets on";
  }
  EXPECT_GT(pages, 1);
  ASSERT_EQ(told.size(), labels.size());
  for (size_t i = 0; i < told.size(); ++i) EXPECT_EQ(told[i], labels[i].id.value);
  const auto rest = content_of(labels_beyond(labels, labels.back().id));
  EXPECT_TRUE(rest["labels"].empty() && !rest["more"].get<bool>());
}

/// A reply that the wire refused would never come: whatever is told of, it passes and is understood.
TEST(AdminReply, IsATextForTheWireWhateverIsInIt) {
  Label label;
  label.text = "K\xfc \u202e \x1b[2J \x7f Küche";
  const DamagedFile file{
      .path = "caf\xe9/\u202e.cairnmap", .map = {}, .name = "\xff", .set_aside = {}, .reasons = {"\xfe"}};
  told::Server damaged;
  damaged.damaged = {{file, true}};
  for (const told::Answer& answer : {told::Answer(told::LabelSeen{"\xff", label}), told::Answer(damaged)}) {
    const std::string text = reply_of(answer).text;
    EXPECT_EQ(fault_of_text(text), std::nullopt) << one_line(text);
    EXPECT_TRUE(nlohmann::json::parse(text, nullptr, false).is_object());
  }
  EXPECT_EQ(nlohmann::json::parse(reply_of(damaged).text)["damaged"][0]["file"], "caf\\xe9/\\u202e.cairnmap");
  EXPECT_EQ(fault_of_text(reply_of(refusal(ErrorCode::kIo, "caf\xe9\n")).text), std::nullopt);
}

TEST(AdminReply, OfADamagedFileTheFirstReasonsAreToldAndHowManyMoreThereAre) {
  constexpr size_t kLines = 400;
  DamagedFile file{.path = "damaged/x.cairnmap", .map = {}, .name = "desk", .set_aside = {}, .reasons = {}};
  for (size_t i = 0; i < kLines; ++i) file.reasons.push_back("row " + std::to_string(i));
  const auto told = describe(told::DamagedSeen{file, true})["reasons"];
  ASSERT_GE(told.size(), 2U);
  ASSERT_LE(told.size(), 10U);
  EXPECT_EQ(told.front(), "row 0");
  EXPECT_EQ(told.back(), "and " + std::to_string(kLines - told.size() + 1) + " more, in the .txt beside it");
  file.reasons.resize(1);
  EXPECT_EQ(describe(told::DamagedSeen{file, true})["reasons"].size(), 1U);
}

TEST(AdminReply, OnlyDamageOfADeletedMapIsCalledSoAndItsPurgeAdvised) {
  DeletedMap map;
  map.header.id = MapId{{1}};
  EXPECT_FALSE(describe(map).contains("damaged") || describe(map).contains("unreadable"));
  for (const ErrorCode code : {ErrorCode::kDamaged, ErrorCode::kConfiguration, ErrorCode::kIo,
                               ErrorCode::kNotFound, ErrorCode::kInternal}) {
    map.problem = Error{code, "1.cairnmap: for a reason"};
    const bool is_damaged = code == ErrorCode::kDamaged;
    const auto told = describe(map);
    EXPECT_EQ(told.value("damaged", "") == map.problem->message, is_damaged);
    EXPECT_EQ(told.value("unreadable", "") == map.problem->message, !is_damaged);
    const wire::AdminReply reply = reply_of(refusal(map));
    const bool says_itself = is_damaged || code == ErrorCode::kIo;
    EXPECT_EQ(reply.result, exit_code(says_itself ? code : ErrorCode::kRefused));
    EXPECT_TRUE(reply.text.starts_with(map.problem->message)) << reply.text;
    EXPECT_EQ(reply.text.find("cairnctl maps purge " + to_hex(map.header.id.bytes)) != std::string::npos,
              is_damaged)
        << reply.text;
  }
}

TEST(AdminReply, TheHealthSaysNothingOfDamageWhereThereIsNone) {
  EXPECT_EQ(word_of_damage(0, "store/damaged"), "");
  EXPECT_NE(word_of_damage(3, "store/damaged").find("3 damaged files"), std::string::npos);
}

TEST(AdminReply, TheHealthNamesTheFirstMapThatIsNotServed) {
  EXPECT_EQ(word_of_unloaded({}), "");
  const std::vector<UnloadedMap> maps{{MapId{{1}}, "", "maps/1.cairnmap", "1.cairnmap: of a newer version"},
                                      {MapId{{2}}, "", "maps/2.cairnmap", "2.cairnmap: in use"}};
  EXPECT_NE(word_of_unloaded(std::span(maps).first(1)).find("a map is not served"), std::string::npos);
  const std::string both = word_of_unloaded(maps);
  EXPECT_NE(both.find("2 maps are not served"), std::string::npos) << both;
  EXPECT_NE(both.find("of a newer version"), std::string::npos) << both;
  EXPECT_EQ(both.find("in use"), std::string::npos) << both;
}

TEST(AdminReply, AnUnknownMapIsNamedWithTheRemedy) {
  const wire::AdminReply reply = reply_of(unknown_map("attic"));
  EXPECT_EQ(reply.result, exit_code(ErrorCode::kRefused));
  EXPECT_NE(reply.text.find("'attic'"), std::string::npos) << reply.text;
  EXPECT_NE(reply.text.find("cairnctl maps"), std::string::npos) << reply.text;
}

TEST(AdminReply, ADeletedMapIsNamedWithTheRemedy) {
  const wire::AdminReply reply = reply_of(deleted_map("attic"));
  EXPECT_EQ(reply.result, exit_code(ErrorCode::kRefused));
  EXPECT_NE(reply.text.find("'attic' is deleted"), std::string::npos) << reply.text;
  EXPECT_NE(reply.text.find("cairnctl map attic undelete"), std::string::npos) << reply.text;
}

}  // namespace
}  // namespace cairn
