// Windows into tables. c holds tables of rows of equal width, and a window of each, which the functions above see instead:
//
//   rows(t, x, c -> row)   row of each cursor, as numbers from 0 on
//
// Rows change at jumps and events alone. TABLE_CURSOR, TABLE_FIRST, TABLE_WINDOW and TABLE_WIDTH tell of each table which
// cursor it has, where its first row and its window lie in c, and how wide they are. An event's update sees what was
// shown before it. Where TABLE_NOISE is not -1 it tells where the rows begin among the random numbers of a rollout, which
// no function sees.

// Let the windows of lane l show its rows, and derivatives along its direction likewise.
static void fill(Trajectory& at, int l) {
  for (int i = 0; i < TABLES; ++i) {
    if (TABLE_NOISE[i] >= 0) {
      const double* drawn = at.noise[l] + TABLE_NOISE[i] + int(lane(at.now.row[TABLE_CURSOR[i]], l)) * TABLE_WIDTH[i];
      for (int j = 0; j < TABLE_WIDTH[i]; ++j) lane(at.c[TABLE_WINDOW[i] + j], l) = drawn[j];
      continue;
    }
    const int from = TABLE_FIRST[i] + int(lane(at.now.row[TABLE_CURSOR[i]], l)) * TABLE_WIDTH[i], to = TABLE_WINDOW[i];
    for (int j = 0; j < TABLE_WIDTH[i]; ++j) {
      lane(at.c[to + j], l) = lane(at.c[from + j], l);
#ifdef WITH_RATE
      if (!C_SLOPES) continue;
      const int slope = C_SLOPE[from + j];
      if (C_SLOPE[to + j] >= 0) lane(at.c[C_SLOPE[to + j]], l) = slope < 0 ? 0. : lane(at.c[slope], l);
#endif
    }
  }
}

// Find the rows of the lanes where they may have changed.
INLINE void look_up(Trajectory& at) {
  Position& now = at.now;
  if (!any(now.turned)) return;
  real row[CURSORS];
  const real t[1] = {now.step.t};
  G::rows(t, now.x, at.c, row);
  for (int l = 0; l < LANES; ++l) {
    if (lane(now.turned, l) == 0) continue;
    for (int k = 0; k < CURSORS; ++k) lane(now.row[k], l) = lane(row[k], l);
    fill(at, l);
  }
  now.turned = 0.;
}
