// SPDX-License-Identifier: Apache-2.0
#include "server/admin/export_folder.h"

#include <gtest/gtest.h>

#include <fstream>
#include <set>

#include "common/io/test_directory.h"
#include "server/admin/scene_files.h"

namespace cairn {
namespace {

namespace fs = std::filesystem;

/// What is there of a folder's tree, without folders.
std::set<std::string> files_in(const fs::path& folder) {
  std::set<std::string> files;
  for (const auto& entry : fs::recursive_directory_iterator(folder)) {
    if (!entry.is_directory()) files.insert(fs::relative(entry.path(), folder));
  }
  return files;
}

std::string content_of(const fs::path& file) {
  std::ifstream in(file, std::ios::binary);
  return {std::istreambuf_iterator<char>(in), {}};
}

/// A map of so many images, all of one point.
ExportedScene scene_of(uint32_t images) {
  ExportedScene scene;
  scene.cameras[1] = {CameraModel::kPinholeRadtan, 8, 6, {8, 8, 4, 3}};
  ExportedPoint point;
  point.id = PointId{1};
  point.position = {0, 0, 2};
  for (uint32_t id = 1; id <= images; ++id) {
    ExportedImage exported;
    exported.id = id;
    exported.camera = 1;
    exported.file = "keyframe-00000" + std::to_string(id) + ".png";
    exported.found.emplace_back(point.id, Eigen::Vector2d(4, 3));
    exported.image = std::make_shared<const GrayImage>(8, 6);
    point.track.emplace_back(id, 0);
    scene.images.push_back(std::move(exported));
  }
  scene.points.push_back(point);
  return scene;
}

class ExportFolder : public ::testing::Test {
 protected:
  Status leave(const ExportedScene& scene, const std::string& format) const {
    const auto staging = StagingFolder::make_in(folder_);
    if (!staging) return tl::unexpected(staging.error());
    return leave_scene(scene, format, *staging, place());
  }
  void put(const fs::path& file) const {
    fs::create_directories(file.parent_path());
    std::ofstream(file) << "the user's";
  }
  [[nodiscard]] fs::path place() const { return folder_ / "desk"; }

  TestDirectory directory_;
  const fs::path& folder_ = directory_.path();
};

TEST_F(ExportFolder, ASecondExportLeavesNothingOfTheFirst) {
  ASSERT_TRUE(leave(scene_of(3), "all"));
  ASSERT_EQ(files_in(folder_).size(), 3 + 3 + 3 + 1);
  ASSERT_TRUE(leave(scene_of(2), "all"));
  EXPECT_EQ(files_in(place() / "images"),
            (std::set<std::string>{"keyframe-000001.png", "keyframe-000002.png"}));
  EXPECT_EQ(files_in(folder_).size(), 2 + 3 + 3 + 1) << "and nothing hidden beside";
}

TEST_F(ExportFolder, WhatWasNotAskedForStaysUnlessItsImagesGo) {
  ASSERT_TRUE(leave(scene_of(3), "all"));
  const std::string ply = content_of(place() / "points.ply");
  const std::string text = content_of(place() / "sparse-text/images.txt");
  ASSERT_TRUE(leave(scene_of(2), "ply"));
  EXPECT_EQ(content_of(place() / "sparse-text/images.txt"), text);
  ASSERT_TRUE(leave(scene_of(2), "colmap"));
  EXPECT_EQ(content_of(place() / "sparse-text/images.txt").find("keyframe-000003"), std::string::npos);
  EXPECT_EQ(content_of(place() / "points.ply"), ply);
}

TEST_F(ExportFolder, TouchesNothingWhereSomethingOfAnothersLies) {
  ASSERT_TRUE(leave(scene_of(3), "all"));
  for (const char* name :
       {"images/keyframe-000001.jpg", "images/keyframe-x.png", "images/sub/keyframe-000001.png",
        "sparse/project.ini", "sparse-text/cameras.bin"}) {
    const fs::path file = place() / name;
    put(file);
    const auto before = files_in(folder_);
    const Status left = leave(scene_of(2), "all");
    ASSERT_FALSE(left) << name;
    EXPECT_EQ(left.error().code, ErrorCode::kRefused);
    EXPECT_NE(left.error().message.find("--out"), std::string::npos) << left.error().message;
    EXPECT_EQ(files_in(folder_), before);
    fs::remove_all(file.parent_path() == place() / "images/sub" ? file.parent_path() : file);
  }
  put(place() / "points.ply");
  EXPECT_FALSE(leave(scene_of(2), "ply"));
  EXPECT_EQ(content_of(place() / "points.ply"), "the user's");
  put(place() / "notes.txt");
  EXPECT_TRUE(leave(scene_of(2), "colmap")) << "beside our parts is nobody's way";
  EXPECT_EQ(content_of(place() / "notes.txt"), "the user's");
}

TEST_F(ExportFolder, WhatCannotBeWrittenIsNamedWithTheReason) {
  const Status full = write_ply(scene_of(1), "/dev/full");
  ASSERT_FALSE(full);
  EXPECT_EQ(full.error().message, "/dev/full: cannot be written: No space left on device");
  put(folder_ / "file");
  const Status no_folder = write_colmap_text(scene_of(1), folder_ / "file/sparse");
  ASSERT_FALSE(no_folder);
  EXPECT_NE(no_folder.error().message.find("file/sparse: cannot be made: Not a directory"), std::string::npos)
      << no_folder.error().message;
  fs::create_directories(folder_ / "desk.cairnmap/full");
  const Status in_the_way = leave_file(folder_ / "file", folder_ / "desk.cairnmap");
  ASSERT_FALSE(in_the_way);
  EXPECT_NE(in_the_way.error().message.find("desk.cairnmap: cannot be written: Is a directory"),
            std::string::npos)
      << in_the_way.error().message;
}

TEST_F(ExportFolder, WhatCannotBeStagedIsToldOfWhereItWasToGo) {
  const auto staging = StagingFolder::make_in(folder_);
  ASSERT_TRUE(staging);
  put(staging->path() / "images");  // in the way, as a full disk would be
  const Status left = leave_scene(scene_of(1), "colmap", *staging, place());
  ASSERT_FALSE(left);
  EXPECT_TRUE(left.error().message.starts_with((place() / "images").string())) << left.error().message;
  EXPECT_EQ(left.error().message.find(".cairnctl"), std::string::npos) << left.error().message;
  const Error of_others{ErrorCode::kIo, "/elsewhere: cannot be read"};
  EXPECT_EQ(staging->told_of(place(), of_others).message, of_others.message);
}

}  // namespace
}  // namespace cairn
