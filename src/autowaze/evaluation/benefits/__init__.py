"""What drivers gain who know where a spot is free: search distance, time, fuel and money (thesis, sec. 4.4)."""
