// SPDX-License-Identifier: Apache-2.0
#include "tests/bench/places_list.h"

#include <gmock/gmock.h>
#include <algorithm>
#include <fstream>

#include "common/io/test_directory.h"
#include "common/io/text.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;
using ::testing::HasSubstr;

std::string complaint(const std::string& content) {
  const auto list = parse_places(content, "list.txt");
  return list ? "" : list.error().message;
}

void touch(const fs::path& file) {
  fs::create_directories(file.parent_path());
  std::ofstream stream(file);
}

TEST(PlacesList, ARowSaysHowAPlaceIsMappedAndWhatIsKnownOfIt) {
  const auto list = parse_places(
      "# a comment\n"
      "video kitchen - truth.txt m 400\n"
      "video monitors d435.txt elsewhere - 130\n"
      "stills fox camera.yaml truth.txt -\n\n"
      "unmapped hall -\n",
      "list.txt");
  ASSERT_TRUE(list) << list.error().message;
  ASSERT_EQ(list->size(), 4U);
  const auto& kitchen = (*list)[0];
  EXPECT_EQ(kitchen.kind, ListedPlace::Kind::kVideo);
  EXPECT_EQ(kitchen.name, "kitchen");
  EXPECT_EQ(kitchen.camera, "");
  EXPECT_EQ(kitchen.truth, "truth.txt");
  EXPECT_TRUE(kitchen.is_metric);
  EXPECT_EQ(kitchen.mapped_frames, 400U);
  EXPECT_FALSE(kitchen.asks_elsewhere);
  const auto& monitors = (*list)[1];
  EXPECT_EQ(monitors.camera, "d435.txt");
  EXPECT_EQ(monitors.truth, "") << "elsewhere is no file";
  EXPECT_TRUE(monitors.asks_elsewhere);
  EXPECT_FALSE(monitors.is_metric);
  EXPECT_EQ((*list)[2].kind, ListedPlace::Kind::kStills);
  EXPECT_EQ((*list)[2].truth, "truth.txt");
  EXPECT_EQ((*list)[3].kind, ListedPlace::Kind::kUnmapped);
  EXPECT_EQ((*list)[3].truth, "");
}

TEST(PlacesList, AWrongRowIsNamedWithItsLineAndWhatItShouldBe) {
  EXPECT_EQ(complaint("unmapped hall -\nvidoe kitchen - - - 4\n"),
            "list.txt:2: no kind of place is 'vidoe'; did you mean video?");
  EXPECT_EQ(complaint("video kitchen - truth.txt m\n"),
            "list.txt:1: 5 fields; expected video FOLDER CAMERA TRUTH UNIT FRAMES");
  EXPECT_THAT(complaint("unmapped hall - truth.txt\n"), HasSubstr("expected unmapped FOLDER CAMERA"));
  for (const std::string frames : {"0", "-4", "4x", "many"})
    EXPECT_EQ(complaint("video kitchen - - - " + frames),
              "list.txt:1: '" + frames + "' is no number of FRAMES");
  EXPECT_EQ(complaint("stills fox - truth.txt cm\n"), "list.txt:1: 'cm' is no UNIT: m or -");
  EXPECT_THAT(complaint("stills fox - - m\n"), HasSubstr("TRUTH is missing"));
  EXPECT_EQ(complaint("unmapped ../hall -\n"), "list.txt:1: '../hall' is no name of a folder");
  EXPECT_EQ(complaint("unmapped hall -\nstills hall - truth.txt m\n"), "list.txt:2: hall is listed twice");
  EXPECT_EQ(complaint("# nothing\n"), "list.txt: lists no places");
}

TEST(PlacesList, TheOneThatIsBuiltIsRight) {
  const fs::path file = CAIRN_PLACES_LIST;
  const auto content = read_file(file);
  ASSERT_TRUE(content) << content.error().message;
  const auto list = parse_places(*content, file);
  ASSERT_TRUE(list) << list.error().message;
  EXPECT_GE(list->size(), 13U);
  for (const char* camera : {"d435-camera.txt", "cube-camera.txt"}) {
    const auto is_its = [&](const ListedPlace& place) { return place.camera == camera; };
    EXPECT_EQ(std::count_if(list->begin(), list->end(), is_its), 1) << camera;
    EXPECT_TRUE(fs::exists(file.parent_path() / camera)) << camera;
  }
}

TEST(PlacesList, FilesAreFoundInTheRecordingAndACameraBesideTheList) {
  const TestDirectory scratch;
  const fs::path& all = scratch.path();
  const std::string data = all / "data";
  touch(all / "data/fox/rgb.txt");
  touch(all / "data/desk/video.mp4");
  touch(all / "data/desk/times.txt");
  touch(all / "data/fox/own.txt");
  touch(all / "list/own.txt");
  touch(all / "list/told.txt");
  const auto find = [&](const ListedPlace& place) { return find_files(place, all / "data", all / "list"); };
  const auto fox = find({.name = "fox", .camera = "own.txt", .truth = "truth.txt"});
  ASSERT_TRUE(fox) << fox.error().message;
  EXPECT_EQ(fox->source, "tum:" + data + "/fox");
  EXPECT_EQ(fox->camera, data + "/fox/own.txt") << "before one of the same name beside the list";
  EXPECT_EQ(fox->truth, data + "/fox/truth.txt");
  const auto desk = find({.name = "desk", .camera = "told.txt"});
  ASSERT_TRUE(desk) << desk.error().message;
  EXPECT_EQ(desk->source, "video:" + data + "/desk/video.mp4?times=" + data + "/desk/times.txt");
  EXPECT_EQ(desk->camera, all / "list/told.txt");
  EXPECT_EQ(desk->truth, "");
  EXPECT_EQ(find({.name = "desk"})->camera, "");
}

TEST(PlacesList, WhatIsMissingIsNamed) {
  const TestDirectory scratch;
  const std::string data = scratch.path();
  const auto said = [&](const ListedPlace& place) {
    return find_files(place, data, "/list").error().message;
  };
  EXPECT_EQ(said({.name = "fox"}), data + "/fox: no such folder");
  touch(scratch.path() / "fox/video.mp4");
  EXPECT_EQ(said({.name = "fox"}), data + "/fox: holds neither rgb.txt nor video.mp4 and times.txt");
  touch(scratch.path() / "fox/rgb.txt");
  EXPECT_EQ(said({.name = "fox", .camera = "own.txt"}),
            "own.txt is neither in " + data + "/fox nor beside the list, in /list");
}

}  // namespace
}  // namespace cairn
