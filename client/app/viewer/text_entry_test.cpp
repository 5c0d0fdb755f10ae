// SPDX-License-Identifier: Apache-2.0
#include "client/app/viewer/text_entry.h"

#include <gtest/gtest.h>

#include <algorithm>
#include <random>

#include "common/base/utf8.h"
#include "common/map/label.h"

namespace cairn {
namespace {

const cv::Size kImage(640, 524);

TextEntry type(const std::string& text) {
  TextEntry entry;
  for (const char32_t character : code_points(text)) entry.press(*stroke_of(key_code_of(character)));
  return entry;
}

/// As a finger does it: on the key with this cap, whatever the state of Shift.
void tap(const std::string& cap, TextEntry* entry) {
  const auto keys = lay_out_keyboard(kImage, entry->shifted());
  const auto key = std::find_if(keys.begin(), keys.end(), [&](const DrawnKey& k) { return k.cap == cap; });
  ASSERT_NE(key, keys.end()) << cap;
  const auto stroke = stroke_at(keys, (key->place.tl() + key->place.br()) / 2);
  ASSERT_TRUE(stroke.has_value());
  entry->press(*stroke);
}

TEST(TextEntry, IsWhatWasTypedAndErased) {
  TextEntry entry = type("drill prest");
  entry.press(*stroke_of('\b'));
  entry.press(*stroke_of('s'));
  EXPECT_EQ(entry.text(), "drill press");
  EXPECT_EQ(entry.state(), TextEntry::State::kTyping);
  entry.press(*stroke_of('\r'));
  EXPECT_EQ(entry.state(), TextEntry::State::kAccepted);
  entry.press(*stroke_of('x'));
  EXPECT_EQ(entry.text(), "drill press") << "done is done";
}

TEST(TextEntry, ABlankLineIsNotAcceptedAndEscapeCancels) {
  for (const char* text : {"", "   "}) {
    TextEntry entry = type(text);
    entry.press({EntryKey::kAccept});
    EXPECT_EQ(entry.state(), TextEntry::State::kTyping);
    entry.press(*stroke_of(0x1b));
    EXPECT_EQ(entry.state(), TextEntry::State::kCancelled);
  }
}

TEST(TextEntry, ErasingTakesWholeCharacters) {
  TextEntry entry("caf\xc3\xa9");
  entry.press({EntryKey::kErase});
  EXPECT_EQ(entry.text(), "caf");
  for (int i = 0; i < 5; ++i) entry.press({EntryKey::kErase});
  EXPECT_EQ(entry.text(), "");
}

TEST(TextEntry, HoldsNoMoreThanALabelMay) {
  const TextEntry entry = type(std::string(2 * kMaxLabelBytes, 'x'));
  EXPECT_EQ(entry.text().size(), kMaxLabelBytes);
}

TEST(TextEntry, TakesTheLettersOfAnyKeyboardAndErasesThemWhole) {
  for (const std::string text : {"Küche", "工作台", "Ku\u0308che", "می\u200cخواهم", "👩\u200d🔧"}) {
    TextEntry entry = type(text);
    EXPECT_EQ(entry.text(), text);
    for (size_t left = letters(text).size(); left > 0; --left) {
      EXPECT_FALSE(entry.text().empty());
      entry.press({EntryKey::kErase});
    }
    EXPECT_EQ(entry.text(), "");
  }
}

TEST(TextEntry, AFullLineIsCutBetweenLetters) {
  const TextEntry entry = type(std::string(kMaxLabelBytes - 1, 'x') + "ü");
  EXPECT_EQ(entry.text(), std::string(kMaxLabelBytes - 1, 'x'));
}

TEST(TextEntry, WhateverIsPressedItMayBeShown) {
  std::mt19937 random(4);
  TextEntry entry;
  for (int i = 0; i < 5000; ++i) {
    const auto stroke = stroke_of(static_cast<int>(random() % 2 * 0x01000000 + random() % 0x12000));
    if (stroke && stroke->key != EntryKey::kCancel && stroke->key != EntryKey::kAccept) entry.press(*stroke);
    entry.press({EntryKey::kCharacter, static_cast<char32_t>(random())});
  }
  EXPECT_FALSE(entry.text().empty());
  EXPECT_EQ(fault_of_text(entry.text()), std::nullopt);
  EXPECT_LE(entry.text().size(), kMaxLabelBytes);
}

TEST(TextEntry, KeysOfNoLineMeanNothing) {
  for (const int code : {-1, 0, 0x09, 0xffe1, 0xff51, 0x1ff}) EXPECT_FALSE(stroke_of(code)) << code;
}

TEST(DrawnKeyboard, WritesWhatItsCapsSay) {
  TextEntry entry;
  tap("Shift", &entry);
  tap("V", &entry);
  for (const char* cap : {"i", "c", "e", "Space", "2", "x", "Erase"}) tap(cap, &entry);
  EXPECT_EQ(entry.text(), "Vice 2");
  tap("Shift", &entry);
  tap("Shift", &entry);
  tap("a", &entry);
  EXPECT_EQ(entry.text(), "Vice 2a") << "Shift twice is none";
  tap("OK", &entry);
  EXPECT_EQ(entry.state(), TextEntry::State::kAccepted);
  TextEntry other;
  tap("Cancel", &other);
  EXPECT_EQ(other.state(), TextEntry::State::kCancelled);
}

TEST(DrawnKeyboard, IsInTheImageWithNoKeyOverAnother) {
  for (const cv::Size image : {kImage, cv::Size(768, 620), cv::Size(1283, 970)}) {
    const auto keys = lay_out_keyboard(image, false);
    int area = 0;
    for (size_t i = 0; i < keys.size(); ++i) {
      EXPECT_EQ(keys[i].place & cv::Rect({0, 0}, image), keys[i].place) << keys[i].cap;
      EXPECT_GE(keys[i].place.y, image.height / 2 - 1) << "the upper half stays free";
      EXPECT_GE(std::min(keys[i].place.width, keys[i].place.height), 40) << "a finger's width";
      for (size_t j = 0; j < i; ++j) EXPECT_EQ((keys[i].place & keys[j].place).area(), 0);
      area += keys[i].place.area();
    }
    EXPECT_NEAR(area, image.area() / 2.0, 0.02 * image.area());
    EXPECT_FALSE(stroke_at(keys, {10, 10}));
  }
}

}  // namespace
}  // namespace cairn
