"""Operations on readings that steps share; pure."""
