// Windows into tables. c has tables of rows of equal width, and a window of each, which the functions above read instead:
//
//   rows(t, x, c -> row)   row of each cursor, numbered from 0
//
// Rows change only at jumps and events. TABLE_CURSOR is the cursor of each table, TABLE_FIRST and TABLE_WINDOW are the
// indices in c of its first row and of its window, TABLE_WIDTH is their width. An event's update reads the rows from before
// the event. If TABLE_NOISE is not -1, the rows are random numbers of a rollout, which no function reads, and it is the
// index of the first.

// Fill the windows of lane l with its rows, and with their derivatives along its direction.
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

// Update the rows of the lanes in which they may have changed.
INLINE void look_up(Trajectory& at) {
  Position& now = at.now;
  if (!any(now.stale)) return;
  real row[CURSORS];
  const real t[1] = {now.step.t};
  G::rows(t, now.x, at.c, row);
  for (int l = 0; l < LANES; ++l) {
    if (lane(now.stale, l) == 0) continue;
    for (int k = 0; k < CURSORS; ++k) lane(now.row[k], l) = lane(row[k], l);
    fill(at, l);
  }
  now.stale = 0.;
}
