// SPDX-License-Identifier: Apache-2.0
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "server/relocalization/compact.h"

namespace cairn {

/// The nearest of many compact pictures, by FLANN's randomised kd-trees (Muja and Lowe, PAMI 2014): approximate, so
/// more are asked for than are wanted and all are compared exactly afterwards. Immutable once made; any number of
/// threads may ask. Its trees are drawn from the machine's entropy (FLANN 1.9.2 knows no seed), so what is left out
/// differs from one making to the next.
class PictureForest {
 public:
  /// Takes seconds for 100 000 pictures: not for a thread that anybody waits for. The pictures are kept: FLANN has
  /// pointers to them.
  explicit PictureForest(std::vector<Compact> pictures);
  ~PictureForest();
  PictureForest(const PictureForest&) = delete;
  PictureForest& operator=(const PictureForest&) = delete;

  [[nodiscard]] size_t size() const;
  /// Indices of at most `count` pictures near the query, ascending by distance, in memory of the caller's.
  void find(const Compact& query, size_t count, std::vector<uint32_t>* out) const;

 private:
  struct Trees;
  std::unique_ptr<Trees> trees_;
};

}  // namespace cairn
