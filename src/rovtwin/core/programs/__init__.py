"""Compiled programs: how functions are compiled (`compiled`), and kept between processes without a trace (`kept`)."""
