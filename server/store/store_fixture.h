// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <filesystem>
#include <memory>
#include <string>
#include <vector>

#include "server/store/kept_map_fixture.h"
#include "server/store/store.h"

namespace cairn::testing {

/// The map of the test scene, in a store of its own.
class StoreFixture : public KeptMapFixture {
 protected:
  [[nodiscard]] std::unique_ptr<Store> open() const {
    auto store = Store::open(folder_, null_logger());
    EXPECT_TRUE(store) << store.error().message;
    return store ? std::move(*store) : nullptr;
  }
  void keep(Store* store) {
    start();
    const Status made = store->create(header_, take_update());
    ASSERT_TRUE(made) << made.error().message;
  }
  /// A map whose last change, its name "bench", is in its log alone, as a kill leaves both: copied to `file`
  /// and `file`-wal.
  void keep_apart(const std::filesystem::path& file) {
    const auto store = open();
    keep(store.get());
    ASSERT_TRUE(store->rename(header_.id, "bench"));
    for (const char* end : {"", "-wal"})
      std::filesystem::copy_file(store->path_of(header_.id).string() + end, file.string() + end);
    ASSERT_GT(std::filesystem::file_size(file.string() + "-wal"), 0U);
  }
  [[nodiscard]] static std::string name_in(const std::filesystem::path& file) {
    const auto opened = MapFile::open(file);
    return opened ? opened->header().name : opened.error().message;
  }
  [[nodiscard]] std::vector<std::string> files_in(const char* part) const {
    std::vector<std::string> names;
    for (const auto& entry : std::filesystem::directory_iterator(folder_ / part))
      names.push_back(entry.path().filename().string());
    std::sort(names.begin(), names.end());
    return names;
  }
};

}  // namespace cairn::testing
